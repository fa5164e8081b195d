"""The kinds of problem: a module each, or a folder with keys.py and kind.py; see ARCHITECTURE.md."""
