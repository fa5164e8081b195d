"""What generated C costs beside closed forms by hand, in instructions counted by callgrind: no time, no noise."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.bench.callgrind import Call, Count, body_call, count, generate, missing, run
from tests.bench.three_link_pairs import LIMITS, LINK_MASSES, PEER, RATIO, Pair, Pairs, three_link_pairs
from tests.support.compare import relative_error

# two roads of some hundred operations, as in tests/robots/test_three_link.py
ROUND_OFF = 1e-12


# measured 1.14 with gcc 12.2; it was the dearest, at RATIO itself, when fmin was a call and cores went by QR
DEAREST = "forward_dynamics_T_linear"
DEAREST_RATIO = 1.25


MASSES = [pytest.param(name, marks=[pytest.mark.proof] * (name == "massless links")) for name in LINK_MASSES]


@pytest.fixture(scope="module", params=MASSES)
def pairs(request: pytest.FixtureRequest) -> Pairs:
    return three_link_pairs(request.param)


@pytest.fixture(scope="module")
def sources(pairs: Pairs, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("cost") / "generated"
    return [*generate({p.key: p.function for p in pairs.all}, folder), PEER]


@pytest.fixture(scope="module")
def counts(pairs: Pairs, sources: list[Path], callgrind: None) -> dict[str, tuple[Count, Count]]:
    """(generated, by hand) by key."""
    found = count(_calls(pairs.all), sources, pairs.parameters)
    return {p.key: (found[f"generated {p.key}"], found[f"by hand {p.key}"]) for p in pairs.all}


def _calls(pairs: list[Pair]) -> dict[str, Call]:
    generated = {f"generated {p.key}": body_call(p.key, p.function, p.peer.points) for p in pairs}
    return generated | {f"by hand {p.key}": p.peer for p in pairs}


def test_peer_and_generated_code_compute_the_same(pairs: Pairs, sources: list[Path]) -> None:
    written = run(_calls(pairs.all), sources, pairs.parameters)
    for p in pairs.all:
        by_hand, generated = written[f"by hand {p.key}"], written[f"generated {p.key}"][:, :3]
        assert relative_error(by_hand, p.expected) < ROUND_OFF, p.title
        assert relative_error(generated, by_hand) < ROUND_OFF, p.title


def test_peer_is_a_decent_one(counts: dict[str, tuple[Count, Count]]) -> None:
    costs = {key: counts[key][1].instructions for key in LIMITS}
    assert {key: cost for key, cost in costs.items() if cost > LIMITS[key]} == {}


def test_generated_code_costs_no_more_than_half_as_much_again(counts: dict[str, tuple[Count, Count]]) -> None:
    ratios = {key: generated.instructions / by_hand.instructions for key, (generated, by_hand) in counts.items()}
    assert len(ratios) == 9
    assert {key: round(ratio, 2) for key, ratio in ratios.items() if ratio > RATIO} == {}
    assert ratios[DEAREST] < DEAREST_RATIO


def test_counts_repeat_and_do_not_depend_on_the_number_of_calls(
    pairs: Pairs, counts: dict[str, tuple[Count, Count]], sources: list[Path]
) -> None:
    p = next(p for p in pairs.all if p.key == "fk")  # it has no branch
    first = replace(p.peer, points=p.peer.points[:1])
    again = count({"one": first, "all": p.peer}, [PEER], pairs.parameters)
    assert again["one"].instructions == again["all"].instructions == counts["fk"][1].instructions
    assert np.array_equal(again["all"].outputs, counts["fk"][1].outputs)


def test_a_missing_tool_is_named_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda tool: None if tool == "valgrind" else f"/usr/bin/{tool}")
    assert missing() == (
        "there is no valgrind on this machine, so no instruction can be counted: install the package valgrind"
    )
