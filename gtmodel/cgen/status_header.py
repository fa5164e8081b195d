"""gt_status.h: the statuses of Python's table in C."""

from __future__ import annotations

import textwrap

from ..results.status import c_enum, c_sentences

_TEMPLATE = """\
/* What a function on data ends with. Made from the table that Python uses, gtmodel/results/status.py. */
#ifndef GT_STATUS_H
#define GT_STATUS_H

{enum}
/* The sentence of a status in plain English, for logs and operators. */
static inline const char *gt_status_sentence(gt_status status)
{{
{sentences}\
    const int count = (int)(sizeof(gt_status_sentences) / sizeof(gt_status_sentences[0]));
    const int code = (int)status;

    return ((code >= 0) && (code < count)) ? gt_status_sentences[code] : "a status that does not exist";
}}

#endif
"""


def status_header() -> str:
    """Text of gt_status.h; codegen/runtime holds the same text, and a test keeps them equal."""
    return _TEMPLATE.format(enum=c_enum(), sentences=textwrap.indent(c_sentences(), "    "))
