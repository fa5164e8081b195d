"""gtmodel watch: the report follows the file, on this machine alone."""

from __future__ import annotations

import shutil
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from gtmodel._watch import HERE, FollowedProblem, serving
from gtmodel.problem_files.base import InputError

PROBLEM = Path(__file__).resolve().parents[1] / "problems" / "table_6_1.toml"


def asked(address: str, path: str = "/", host: str = "") -> tuple[int, str]:
    place = urlsplit(address)
    connection = HTTPConnection(place.hostname or "", place.port, timeout=10)
    connection.request("GET", path, headers={"Host": host or place.netloc})
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def test_the_report_follows_the_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    shutil.copy(PROBLEM, file)
    watched = FollowedProblem(str(file))
    assert watched.look().startswith("solved") and watched.look() == ""
    with serving(FollowedProblem(str(file))) as address:
        assert "being solved" in asked(address)[1] and asked(address, "/number") == (200, "0")
        assert asked(address, "/favicon.ico")[0] == 200  # which every browser asks for
        with pytest.raises(InputError, match="in use"), serving(watched, int(address.rpartition(":")[2].strip("/"))):
            pass
    with serving(watched) as address:
        assert address.startswith(f"http://{HERE}:")
        status, first = asked(address)
        assert status == 200 and "<h2>Result</h2>" in first and asked(address, "/number") == (200, "1")
        file.write_text(file.read_text().replace("Table 6.1", "Another title"))
        assert watched.look() and "Another title" in asked(address)[1] and asked(address, "/number")[1] == "2"
        file.write_text("kind = ")
        assert "not TOML" in watched.look() and "not TOML" in asked(address)[1]
        assert asked(address, host="example.org")[0] == 403 and asked(address, "/../mine.toml")[0] == 404
    with pytest.raises(ConnectionError):
        asked(address)


def test_a_problem_that_is_not_there_is_refused() -> None:
    with pytest.raises(InputError):
        FollowedProblem("nowhere.toml").look()
