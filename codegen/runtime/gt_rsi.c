/* gt_rsi: see gt_rsi.h. One pass over the bytes; every index is tested against the length before it is used. */
#include "gt_rsi.h"

#include "gt_decimal.h"
#include "gt_scan.h"
#include "gt_wire.h"

#include <string.h>

#define GT_RSI_SIX (GT_RSI_RIST | GT_RSI_RSOL | GT_RSI_AIPOS | GT_RSI_ASPOS | GT_RSI_EIPOS | GT_RSI_ESPOS)

/* Which of the six numbers an attribute means: X Y Z A B C, A1 to A6 or E1 to E6; 6 for none. */
static uint32_t gt_rsi_place(const gt_scanner *s, gt_piece name, uint32_t element)
{
    static const char letters[] = "XYZABC";
    const uint32_t length = name.end - name.at;
    const char letter = ((element & (GT_RSI_AIPOS | GT_RSI_ASPOS)) != 0U) ? 'A' : 'E';
    uint32_t n;

    for (n = 0U; n < 6U; n++) {
        if ((element & (GT_RSI_RIST | GT_RSI_RSOL)) != 0U) {
            if ((length == 1U) && (gt_byte_at(s->data, name.at, s->end) == (uint8_t)letters[n])) {
                return n;
            }
        } else if ((length == 2U) && (gt_byte_at(s->data, name.at, s->end) == (uint8_t)letter) &&
                   (gt_byte_at(s->data, name.at + 1U, s->end) == (uint8_t)('1' + (int)n))) {
            return n;
        } else {
            /* not this one */
        }
    }
    return 6U;
}

static uint32_t gt_rsi_element(const gt_scanner *s, gt_piece name, gt_rsi_robot *robot, double **numbers,
                               uint32_t **given)
{
    static const char *const names[6] = {"RIst", "RSol", "AIPos", "ASPos", "EIPos", "ESPos"};
    double *places[6];
    uint32_t n;

    places[0] = robot->rist;
    places[1] = robot->rsol;
    places[2] = robot->aipos_deg;
    places[3] = robot->aspos_deg;
    places[4] = robot->eipos_mm;
    places[5] = robot->espos_mm;
    for (n = 0U; n < 6U; n++) {
        if (gt_scan_equals(s, name, names[n])) {
            *numbers = places[n];
            *given = &robot->given[n];
            return 1U << n;
        }
    }
    if (gt_scan_equals(s, name, "Delay")) {
        return GT_RSI_DELAY;
    }
    return gt_scan_equals(s, name, "IPOC") ? GT_RSI_IPOC : 0U;
}

/* The attributes of one element, up to and including '>'; `ended` where that is "/>". */
static int gt_rsi_attributes(gt_scanner *s, uint32_t element, double *numbers, uint32_t *given, gt_rsi_robot *robot,
                             int *ended)
{
    for (;;) {
        gt_piece name;
        gt_piece value;

        gt_scan_spaces(s);
        *ended = gt_scan_over(s, '/');
        if (gt_scan_over(s, '>')) {
            return 1;
        }
        if (*ended != 0) {
            return 0;
        }
        name = gt_scan_word(s);
        if (!gt_scan_quoted(s, &value) || (name.at == name.end)) {
            return 0;
        }
        if ((element == GT_RSI_DELAY) && gt_scan_equals(s, name, "D")) {
            uint64_t delay = 0U;

            if (!gt_read_digits(s->data, value.at, value.end, &delay)) {
                return 0;
            }
            robot->delay = (uint32_t)((delay < UINT32_MAX) ? delay : UINT32_MAX);
        } else if ((element & GT_RSI_SIX) != 0U) {
            const uint32_t place = gt_rsi_place(s, name, element);

            if (place < 6U) {
                const uint32_t bit = ((uint32_t)1U) << place;

                if (((*given & bit) != 0U) ||
                    !gt_read_decimal(s->data, value.at, value.end, &numbers[place])) {
                    return 0;
                }
                *given |= bit;
            }
        } else {
            /* not known: skipped */
        }
    }
}

/* digits</IPOC>, up to and including '>'; spaces and comments round the digits are not part of them */
static int gt_rsi_ipoc(gt_scanner *s, gt_rsi_robot *robot)
{
    gt_piece digits;
    gt_piece name;
    uint32_t n;

    if (!gt_scan_blank(s)) {
        return 0;
    }
    digits = gt_scan_word(s);
    if (!gt_scan_blank(s) || !gt_scan_over(s, '<') || !gt_scan_over(s, '/')) {
        return 0;
    }
    name = gt_scan_word(s);
    gt_scan_spaces(s);
    if (!gt_scan_equals(s, name, "IPOC") || !gt_scan_over(s, '>') ||
        !gt_read_digits(s->data, digits.at, digits.end, &robot->ipoc)) {
        return 0;
    }
    robot->ipoc_length = digits.end - digits.at;
    for (n = 0U; (n < robot->ipoc_length) && (n < GT_RSI_DIGITS); n++) {
        robot->ipoc_text[n] = gt_byte_at(s->data, digits.at + n, s->end);
    }
    return 1;
}

/* One element behind its '<', in `depth` others, which it enters unless it ends at once. */
static int gt_rsi_open(gt_scanner *s, gt_rsi_robot *robot, uint32_t *depth)
{
    const gt_piece name = gt_scan_word(s);
    int outside = 0;
    double *numbers = robot->rist;
    uint32_t *given = &robot->given[0];
    uint32_t element = 0U;
    int ended = 0;

    if (*depth == 0U) {
        outside = 1;
    }
    if ((name.at == name.end) || (gt_scan_equals(s, name, "Rob") != outside)) {
        return 0;
    }
    if (outside == 0) {
        element = gt_rsi_element(s, name, robot, &numbers, &given);
    }
    /* what is read stands once, and in <Rob> itself */
    if ((element != 0U) && ((*depth != 1U) || ((robot->present & element) != 0U))) {
        return 0;
    }
    if (!gt_rsi_attributes(s, element, numbers, given, robot, &ended)) {
        return 0;
    }
    robot->present |= element;
    if (element == GT_RSI_IPOC) {
        return (ended == 0) && gt_rsi_ipoc(s, robot);
    }
    *depth += (ended != 0) ? 0U : 1U;
    return 1;
}

int gt_rsi_read_robot(const uint8_t *data, uint32_t length, gt_rsi_robot *robot)
{
    gt_scanner s;
    uint32_t depth = 0U; /* open elements, <Rob> is the first */

    (void)memset(robot, 0, sizeof(*robot));
    s.data = data;
    s.at = 0U;
    s.end = (length <= GT_DATAGRAM_MAX) ? length : 0U;
    while (s.at < s.end) {
        if (depth == 0U) {
            gt_scan_spaces(&s);
        } else {
            gt_scan_to(&s, '<');
        }
        if (!gt_scan_over(&s, '<')) {
            return 0;
        }
        if (gt_scan_over(&s, '/')) {
            const gt_piece name = gt_scan_word(&s);

            gt_scan_spaces(&s);
            if (!gt_scan_over(&s, '>') || (depth == 0U)) {
                return 0;
            }
            depth--;
            if (gt_scan_equals(&s, name, "Rob") != ((depth == 0U) ? 1 : 0)) {
                return 0;
            }
            if (depth == 0U) {
                return gt_scan_blank(&s) && (s.at == s.end) && ((robot->present & GT_RSI_IPOC) != 0U);
            }
        } else if (gt_scan_over(&s, '?')) {
            gt_scan_to(&s, '>');
            if (!gt_scan_over(&s, '>')) {
                return 0;
            }
        } else if (gt_scan_over(&s, '!')) {
            if (!gt_scan_comment(&s)) {
                return 0;
            }
        } else if (!gt_rsi_open(&s, robot, &depth)) {
            return 0;
        } else {
            /* an element was read */
        }
    }
    return 0;
}
