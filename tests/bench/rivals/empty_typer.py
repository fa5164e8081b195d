"""A typer app of two commands that do nothing: the least time of any such command line to print its help."""

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
