"""A typer app of two commands that do nothing: what any command line of this kind costs before it says its help."""

import typer

app = typer.Typer()


@app.command()
def one(number: int) -> None:
    """Do nothing."""


@app.command()
def two(number: int) -> None:
    """Do nothing."""


if __name__ == "__main__":
    app()
