/* gt_scan: see gt_scan.h. */
#include "gt_scan.h"

#include "gt_wire.h"

static int gt_is_space(uint8_t byte)
{
    return (byte == (uint8_t)' ') || (byte == (uint8_t)'\t') || (byte == (uint8_t)'\r') || (byte == (uint8_t)'\n');
}

static int gt_is_letter(uint8_t byte)
{
    return ((byte >= (uint8_t)'A') && (byte <= (uint8_t)'Z')) || ((byte >= (uint8_t)'a') && (byte <= (uint8_t)'z')) ||
           ((byte >= (uint8_t)'0') && (byte <= (uint8_t)'9')) || (byte == (uint8_t)'_');
}

uint8_t gt_scan_here(const gt_scanner *s)
{
    return gt_byte_at(s->data, s->at, s->end);
}

int gt_scan_over(gt_scanner *s, char byte)
{
    int there = 0;

    if (gt_scan_here(s) == (uint8_t)byte) {
        s->at++;
        there = 1;
    }
    return there;
}

void gt_scan_to(gt_scanner *s, char byte)
{
    while ((s->at < s->end) && (gt_scan_here(s) != (uint8_t)byte)) {
        s->at++;
    }
}

void gt_scan_spaces(gt_scanner *s)
{
    while ((s->at < s->end) && gt_is_space(gt_scan_here(s))) {
        s->at++;
    }
}

int gt_scan_comment(gt_scanner *s)
{
    int open = 0;

    if (gt_scan_over(s, '-') != 0) {
        open = gt_scan_over(s, '-');
    }
    while (open != 0) {
        gt_scan_to(s, '-');
        open = gt_scan_over(s, '-'); /* 0 at the end of the datagram */
        if ((open != 0) && (gt_scan_over(s, '-') != 0)) {
            return gt_scan_over(s, '>');
        }
    }
    return 0;
}

int gt_scan_blank(gt_scanner *s)
{
    int good = 1;

    gt_scan_spaces(s);
    while ((good != 0) && (gt_scan_here(s) == (uint8_t)'<') &&
           (gt_byte_at(s->data, s->at + 1U, s->end) == (uint8_t)'!')) {
        s->at += 2U;
        good = gt_scan_comment(s);
        gt_scan_spaces(s);
    }
    return good;
}

gt_piece gt_scan_word(gt_scanner *s)
{
    gt_piece word;

    word.at = s->at;
    while ((s->at < s->end) && gt_is_letter(gt_scan_here(s))) {
        s->at++;
    }
    word.end = s->at;
    return word;
}

int gt_scan_equals(const gt_scanner *s, gt_piece piece, const char *text)
{
    uint32_t n = 0U;

    while ((text[n] != '\0') && ((piece.at + n) < piece.end) &&
           (gt_byte_at(s->data, piece.at + n, s->end) == (uint8_t)text[n])) {
        n++;
    }
    return (text[n] == '\0') && ((piece.at + n) == piece.end);
}

static int gt_scan_value(gt_scanner *s, char quote, gt_piece *value)
{
    value->at = s->at;
    gt_scan_to(s, quote);
    value->end = s->at;
    return gt_scan_over(s, quote);
}

int gt_scan_quoted(gt_scanner *s, gt_piece *value)
{
    int good;

    value->at = s->at;
    value->end = s->at;
    gt_scan_spaces(s);
    good = gt_scan_over(s, '=');
    if (good != 0) {
        char quote = '"';

        gt_scan_spaces(s);
        if (gt_scan_over(s, quote) == 0) {
            quote = '\'';
            good = gt_scan_over(s, quote);
        }
        if (good != 0) {
            good = gt_scan_value(s, quote, value);
        }
    }
    return good;
}
