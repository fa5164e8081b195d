"""The kinds of problem: a package each, keys.py and kind.py; see ARCHITECTURE.md."""
