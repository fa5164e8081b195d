"""Kinds of problem: each is a module, or a folder with keys.py and kind.py; see ARCHITECTURE.md."""
