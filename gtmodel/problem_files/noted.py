"""Notes of a result: input files marked as not to be used, and remarks about models, such as a moved home pose."""

from __future__ import annotations

from gtmodel.results import Study

from .base import Check, Context, InputError, at_most

NOTES = "notes"  # in `values`; a kind may add its own
NOT_TO_BE_USED = "inputs_not_to_be_used"
DESCRIPTION = "remarks for the reader; left out if there are none"


def noted(outcome: Study, context: Context) -> Study:
    """Return the outcome with the notes about its files and models.

    If the outcome has files for a machine and rests on a file marked as not to be used, a check fails.
    """
    for model in context.models:
        from gtmodel.compiler.causal import notes_of  # here: a schema needs no compiler

        for sentence in notes_of(model):
            context.note(sentence)
    if not context.notes:
        return outcome
    present = list(outcome.values.get(NOTES) or [])
    new = [sentence for sentence in context.notes if sentence not in present]
    outcome = outcome.with_(notes=[*outcome.notes, *new])
    return checked(outcome, context) if outcome.machine_files else outcome


def checked(outcome: Study, context: Context) -> Study:
    """Return the outcome, with a failed check if it rests on files marked as not to be used."""
    return outcome.judged(doubts(context))


def doubts(context: Context) -> dict[str, Check]:
    """Return a failing check if the run used files marked as not to be used; otherwise nothing."""
    if not context.distrusted:
        return {}
    advice = f"create {' and '.join(context.distrusted)} again"
    return {NOT_TO_BE_USED: at_most(float(len(context.distrusted)), 0.0, advice)}


def refuse_distrusted(context: Context, what: str) -> None:
    """Raises InputError if `what`, which a machine would execute, rests on a file marked as not to be used."""
    if context.distrusted:
        raise InputError(
            f"{context.distrusted[0]} says that it is not to be used, and {what} would rest on it; "
            "create it again, or use --write-failed, which writes all files with a mark"
        )
