/* What a function on data ends with. Made from the table that Python uses, gtmodel/results/status.py. */
#ifndef GT_STATUS_H
#define GT_STATUS_H

typedef enum gt_status {
    GT_OK = 0, /* the value was computed */
    GT_OUT_OF_RANGE = 1, /* the input lies outside the range where a solution exists */
    GT_NOT_CONVERGED = 2, /* the iteration did not converge within its limit */
    GT_SINGULAR = 3, /* the equations are singular at this point */
    GT_NOT_FINITE = 4, /* a number that is not finite went in or came out */
    GT_STALE_INPUT = 5, /* the input is older than the loop allows */
    GT_WRONG_BRANCH = 6 /* the iteration led to a solution on another than the wanted branch */
} gt_status;

/* The sentence of a status in plain English, for logs and operators. */
static inline const char *gt_status_sentence(gt_status status)
{
    static const char *const gt_status_sentences[] = {
        "the value was computed", /* GT_OK */
        "the input lies outside the range where a solution exists", /* GT_OUT_OF_RANGE */
        "the iteration did not converge within its limit", /* GT_NOT_CONVERGED */
        "the equations are singular at this point", /* GT_SINGULAR */
        "a number that is not finite went in or came out", /* GT_NOT_FINITE */
        "the input is older than the loop allows", /* GT_STALE_INPUT */
        "the iteration led to a solution on another than the wanted branch" /* GT_WRONG_BRANCH */
    };
    const int count = (int)(sizeof(gt_status_sentences) / sizeof(gt_status_sentences[0]));
    const int code = (int)status;

    return ((code >= 0) && (code < count)) ? gt_status_sentences[code] : "a status that does not exist";
}

#endif
