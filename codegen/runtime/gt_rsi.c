/* gt_rsi: see gt_rsi.h. One pass over the bytes; every index is tested against the length before it is used. */
#include "gt_rsi.h"

#include "gt_decimal.h"
#include "gt_scan.h"
#include "gt_wire.h"

#include <string.h>

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
    return gt_scan_equals(s, name, "Delay") ? GT_RSI_DELAY : 0U;
}

/* The attributes of one element, up to and including '>'. */
static int gt_rsi_attributes(gt_scanner *s, uint32_t element, double *numbers, uint32_t *given, gt_rsi_robot *robot)
{
    for (;;) {
        gt_piece name;
        gt_piece value;

        gt_scan_spaces(s);
        (void)gt_scan_over(s, '/');
        if (gt_scan_over(s, '>')) {
            return 1;
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
        } else if ((element != 0U) && (element != GT_RSI_DELAY)) {
            const uint32_t place = gt_rsi_place(s, name, element);

            if (place < 6U) {
                if (!gt_read_decimal(s->data, value.at, value.end, &numbers[place])) {
                    return 0;
                }
                *given |= ((uint32_t)1U) << place;
            }
        } else {
            /* not known: skipped */
        }
    }
}

/* <IPOC>digits</IPOC>, behind its '>'; spaces round the digits are not part of them */
static int gt_rsi_ipoc(gt_scanner *s, gt_rsi_robot *robot)
{
    gt_piece digits;
    uint32_t n;

    gt_scan_spaces(s);
    digits = gt_scan_word(s);
    gt_scan_spaces(s);
    if ((gt_scan_here(s) != (uint8_t)'<') || !gt_read_digits(s->data, digits.at, digits.end, &robot->ipoc)) {
        return 0;
    }
    robot->ipoc_length = digits.end - digits.at;
    for (n = 0U; (n < robot->ipoc_length) && (n < GT_RSI_DIGITS); n++) {
        robot->ipoc_text[n] = gt_byte_at(s->data, digits.at + n, s->end);
    }
    robot->present |= GT_RSI_IPOC;
    return 1;
}

int gt_rsi_read_robot(const uint8_t *data, uint32_t length, gt_rsi_robot *robot)
{
    gt_scanner s;
    int open = 0; /* inside <Rob> */

    (void)memset(robot, 0, sizeof(*robot));
    s.data = data;
    s.at = 0U;
    s.end = (length <= GT_DATAGRAM_MAX) ? length : 0U;
    while (s.at < s.end) {
        gt_piece name;

        gt_scan_to(&s, '<');
        if (!gt_scan_over(&s, '<')) {
            return 0;
        }
        if (gt_scan_over(&s, '/')) {
            name = gt_scan_word(&s);
            gt_scan_spaces(&s);
            if (!gt_scan_over(&s, '>')) {
                return 0;
            }
            if (gt_scan_equals(&s, name, "Rob")) {
                return open && ((robot->present & GT_RSI_IPOC) != 0U);
            }
        } else if (gt_scan_over(&s, '?')) {
            gt_scan_to(&s, '>');
            if (!gt_scan_over(&s, '>')) {
                return 0;
            }
        } else {
            double *numbers = robot->rist;
            uint32_t *given = &robot->given[0];
            uint32_t element;

            name = gt_scan_word(&s);
            if ((name.at == name.end) || (!open && !gt_scan_equals(&s, name, "Rob"))) {
                return 0;
            }
            open = 1;
            element = gt_rsi_element(&s, name, robot, &numbers, &given);
            if (!gt_rsi_attributes(&s, element, numbers, given, robot)) {
                return 0;
            }
            robot->present |= element;
            if (gt_scan_equals(&s, name, "IPOC") && !gt_rsi_ipoc(&s, robot)) {
                return 0;
            }
        }
    }
    return 0;
}
