#!/usr/bin/env bash
# Builds wheel and source archive, installs each into an empty environment outside the clone, and tries it there.
#
#   tests/try_archives.sh [PYTHON]     # `make dist` and the release workflow; the archives go into dist/
#
# constraints.txt pins hatchling only: dependencies are the newest ones, which a user gets too.
set -euo pipefail

python=$("${1:-python3}" -c "import sys; print(sys.executable)") # absolute
clone=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
archives="$clone/dist"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
unset PYTHONPATH PYTHONHOME
export MPLBACKEND=Agg PIP_DISABLE_PIP_VERSION_CHECK=1 GTMODEL_CACHE="$work/cache"

echo "== build"
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' "$clone/pyproject.toml")
if [ -n "$(git -C "$clone" status --porcelain 2>/dev/null)" ]; then
    echo "note: the clone has uncommitted changes, which go into the archives"
fi
wheel="$archives/gtmodel-$version-py3-none-any.whl"
sdist="$archives/gtmodel-$version.tar.gz"
rm -f "$wheel" "$sdist"
"$python" -m venv "$work/build"
"$work/build/bin/python" -m pip install --quiet --constraint "$clone/constraints.txt" hatchling
(cd "$clone" && "$work/build/bin/python" -m hatchling build --target sdist --target wheel --directory "$archives")

for archive in "$wheel" "$sdist"; do
    echo "== $(basename "$archive"): install"
    rm -rf "$work/away" "$work/env"
    mkdir "$work/away"
    "$python" -m venv "$work/env"
    cd "$work/away"
    "$work/env/bin/python" -m pip install --quiet "$archive"
    "$work/env/bin/python" - "$clone" <<'END'
import pathlib, sys
import gtmodel
from gtmodel._files import codegen_dir, problems_dir

home, clone = pathlib.Path(sys.prefix).resolve(), pathlib.Path(sys.argv[1]).resolve()
for place in (gtmodel.__file__, problems_dir(), codegen_dir()):
    assert pathlib.Path(place).resolve().is_relative_to(home), f"{place} is not in {home}"
assert not any(pathlib.Path(p).resolve() == clone for p in sys.path), f"{clone} is on the path of imports"
END

    echo "== $(basename "$archive"): try"
    gtmodel="$work/env/bin/gtmodel"
    said=$("$gtmodel" --version)
    echo "$said"
    [ "$said" = "gtmodel $version" ] || { echo "expected gtmodel $version"; exit 1; }
    "$gtmodel" list > list.txt
    grep -q l1_tape list.txt || { echo "gtmodel list names no l1_tape"; exit 1; }
    "$gtmodel" solve l1_min_time --quiet --out result # ends with 0 only if it is solved and all checks passed
    "$work/env/bin/python" -c 'import json; assert json.load(open("result/result.json"))["status"] == "solved"'
done
echo "== both work"
ls -l "$wheel" "$sdist"
