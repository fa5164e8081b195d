"""A C compiler that keeps the objects it made, for tests that build the same files again and again in other folders.

An object is kept under the flags, the text of its source and that of all headers between quotes that it reaches: a
changed file is compiled. Programs and libraries are linked anew.
"""

from __future__ import annotations

import os
import shutil
import stat
import sys
from pathlib import Path

SCRIPT = '''#!{python} -IS
import hashlib, os, re, shutil, subprocess, sys
CC, KEPT = {cc!r}, {kept!r}
arguments = sys.argv[1:]
sources = [a for a in arguments if a.endswith(".c")]
if not sources or "-o" not in arguments or {{"-g", "-E", "-fsyntax-only"}} & set(arguments):
    os.execv(CC, [CC, *arguments])
at = arguments.index("-o")
target, rest = arguments[at + 1], arguments[:at] + arguments[at + 2 :]
flags, folders, link, k = [], [], [], 0
while k < len(rest):
    a = rest[k]
    if a == "-I":
        k += 1
        folders.append(rest[k])
    elif a.startswith("-I"):
        folders.append(a[2:])
    elif a.startswith(("-l", "-Wl,")) or a.endswith((".o", ".a")) or a == "-shared":
        link.append(a)
    elif a not in sources and a != "-c":
        flags.append(a)
    k += 1


def texts(path, seen):
    """All that a file is made of, in order."""
    if path in seen:
        return
    seen.add(path)
    with open(path, "rb") as file:
        text = file.read()
    yield text
    for name in re.findall(rb'^[ \\t]*#[ \\t]*include[ \\t]*"([^"]+)"', text, re.M):
        for folder in (os.path.dirname(path) or ".", *folders):
            other = os.path.join(folder, name.decode())
            if os.path.isfile(other):
                yield from texts(other, seen)
                break


def kept(source):
    """The object of a source, compiled where there is none yet."""
    made_of = hashlib.sha256("\\0".join(flags).encode())
    for text in texts(source, set()):
        made_of.update(hashlib.sha256(text).digest())
    object = os.path.join(KEPT, made_of.hexdigest() + ".o")
    if not os.path.isfile(object):
        own = object + str(os.getpid())
        done = subprocess.run([CC, *flags, *["-I" + f for f in folders], "-c", source, "-o", own])
        if done.returncode:
            sys.exit(done.returncode)
        os.replace(own, object)
    return object


objects = [kept(s) for s in sources]
if "-c" in rest:
    shutil.copyfile(objects[0], target)
else:
    os.execv(CC, [CC, *[f for f in flags if not f.startswith("-W")], *objects, *link, "-o", target])
'''


def keeping_compiler(folder: Path) -> str:
    """The path of one for the variable CC, whose objects lie in this folder; empty where there is no compiler or one
    was chosen."""
    cc = shutil.which("cc")
    if cc is None or os.environ.get("CC"):
        return ""
    kept, script = folder / "kept", folder / "cc"
    kept.mkdir()
    script.write_text(SCRIPT.format(python=sys.executable, cc=cc, kept=str(kept)))
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    return str(script)
