/* The wrenches of an RSI telegram; see gt_wrench.h. */
#include "gt_decimal.h"
#include "gt_scan.h"
#include "gt_wrench.h"

#include <string.h>

#define GT_WRENCH_NEEDED 0x7FU /* all but the state */
#define GT_WRENCH_AGE 6U
#define GT_WRENCH_STATE 7U
#define GT_WRENCH_NAMES 8U

/* Which number an attribute is; GT_WRENCH_NAMES for none. */
static uint32_t gt_wrench_place(const gt_scanner *s, gt_piece name)
{
    static const char *const names[GT_WRENCH_NAMES] = {"FX", "FY", "FZ", "MX", "MY", "MZ", "Age", "State"};
    uint32_t n = 0U;

    while ((n < GT_WRENCH_NAMES) && !gt_scan_equals(s, name, names[n])) {
        n++;
    }
    return n;
}

static int gt_wrench_set(const gt_scanner *s, gt_piece value, uint32_t place, gt_wrench *wrench)
{
    uint64_t whole = 0U;
    uint32_t kept;
    int good;

    if (place < 3U) {
        good = gt_read_decimal(s->data, value.at, value.end, &wrench->force_N[place]);
    } else if (place < GT_WRENCH_AGE) {
        good = gt_read_decimal(s->data, value.at, value.end, &wrench->moment_N_m[place - 3U]);
    } else {
        good = gt_read_digits(s->data, value.at, value.end, &whole);
        kept = (whole < UINT32_MAX) ? (uint32_t)whole : UINT32_MAX;
        if (place == GT_WRENCH_AGE) {
            wrench->age_cycles = kept;
        } else {
            wrench->status = kept;
        }
    }
    return good;
}

/* The attributes of one element, up to and including '>'; `wrench` may be NULL. 1 unless they are at fault. */
static int gt_wrench_attributes(gt_scanner *s, gt_wrench *wrench, uint32_t *given, int *ended)
{
    int good = 1;

    gt_scan_spaces(s);
    *ended = gt_scan_over(s, '/');
    while (good && !gt_scan_over(s, '>')) {
        const gt_piece name = gt_scan_word(s);
        gt_piece value;

        if ((*ended != 0) || (name.at == name.end) || (gt_scan_quoted(s, &value) == 0)) {
            good = 0;
        }
        if (good && (wrench != NULL)) {
            const uint32_t place = gt_wrench_place(s, name);
            const uint32_t bit = (place < GT_WRENCH_NAMES) ? (((uint32_t)1U) << place) : 0U;

            if (((*given & bit) != 0U) || ((bit != 0U) && (gt_wrench_set(s, value, place, wrench) == 0))) {
                good = 0;
            }
            *given |= bit;
        }
        gt_scan_spaces(s);
        *ended = gt_scan_over(s, '/');
    }
    return good;
}

/* One element behind its '<', in `depth` others, which it enters unless it ends at once. */
static int gt_wrench_element(gt_scanner *s, uint32_t *depth, gt_wrench *wrenches, uint32_t *given)
{
    static const char *const names[2] = {"FtHandle", "FtTool"};
    const gt_piece name = gt_scan_word(s);
    uint32_t unused = 0U;
    uint32_t *bits = &unused;
    gt_wrench *wrench = NULL;
    uint32_t n;
    int ended = 0;
    int good = 1;

    for (n = 0U; n < 2U; n++) {
        if ((*depth == 1U) && gt_scan_equals(s, name, names[n])) {
            if (given[n] != 0U) {
                good = 0; /* each stands once */
            }
            wrench = &wrenches[n];
            bits = &given[n];
        }
    }
    if ((good != 0) && (gt_wrench_attributes(s, wrench, bits, &ended) == 0)) {
        good = 0;
    }
    *depth += (ended != 0) ? 0U : 1U;
    return good;
}

int gt_rsi_read_wrenches(const uint8_t *data, uint32_t length, gt_wrench *handle, gt_wrench *tool)
{
    gt_wrench wrenches[2];
    uint32_t given[2] = {0U, 0U};
    uint32_t depth = 0U;
    gt_scanner s;
    int good = 1;

    (void)memset(wrenches, 0, sizeof(wrenches));
    s.data = data;
    s.at = 0U;
    s.end = (length <= GT_DATAGRAM_MAX) ? length : 0U;
    gt_scan_to(&s, '<');
    while (good && gt_scan_over(&s, '<')) {
        if (gt_scan_over(&s, '/') != 0) {
            gt_scan_to(&s, '>');
            if (depth > 0U) {
                depth--;
            } else {
                good = 0;
            }
        } else if (gt_scan_over(&s, '?') != 0) {
            gt_scan_to(&s, '>');
        } else if (gt_scan_over(&s, '!') != 0) {
            good = gt_scan_comment(&s);
        } else {
            good = gt_wrench_element(&s, &depth, wrenches, given);
        }
        gt_scan_to(&s, '<');
    }
    if (((given[0] & GT_WRENCH_NEEDED) != GT_WRENCH_NEEDED) || ((given[1] & GT_WRENCH_NEEDED) != GT_WRENCH_NEEDED)) {
        good = 0;
    }
    if (!good) {
        (void)memset(wrenches, 0, sizeof(wrenches));
    }
    *handle = wrenches[0];
    *tool = wrenches[1];
    return good;
}
