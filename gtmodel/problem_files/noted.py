"""What is said of a problem beside its numbers: files that are not to be used, models whose home had to be moved."""

from __future__ import annotations

from gtmodel.results import Study

from .base import Check, Context, InputError, at_most

NOTES = "notes"  # in `values`; a kind may have notes of its own there
NOT_TO_BE_USED = "inputs_not_to_be_used"
DESCRIPTION = "sentences that a person should read; left out where there are none"


def noted(outcome: Study, context: Context) -> Study:
    """The outcome with what is to be said of its files and models in `values` and in the table.

    A machine must not follow what rests on a file that is not to be used: there that is a check, and it fails.
    """
    for model in context.models:
        from gtmodel.compiler.causal import notes_of  # here: a schema needs no compiler

        for sentence in notes_of(model):
            context.note(sentence)
    if not context.notes:
        return outcome
    own = list(outcome.values.get(NOTES) or [])
    new = [sentence for sentence in context.notes if sentence not in own]
    outcome = outcome.with_(notes=[*outcome.notes, *new])
    return checked(outcome, context) if outcome.machine_files else outcome


def checked(outcome: Study, context: Context) -> Study:
    """The outcome with a failed check where it rests on files that are not to be used."""
    return outcome.judged(doubts(context))


def doubts(context: Context) -> dict[str, Check]:
    """A check that fails where files that are not to be used were taken; empty where there are none."""
    if not context.distrusted:
        return {}
    advice = f"make {' and '.join(context.distrusted)} anew"
    return {NOT_TO_BE_USED: at_most(float(len(context.distrusted)), 0.0, advice)}


def refuse_distrusted(context: Context, what: str) -> None:
    """Raises InputError where `what` a machine would follow rests on a file that is not to be used."""
    if context.distrusted:
        raise InputError(
            f"{context.distrusted[0]} says in its first line that it is not to be used, and {what} would rest on it; "
            "make it anew; --write-failed writes all, marked"
        )
