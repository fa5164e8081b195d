/* A scanner of the XML that controllers send, on bytes with a length: what lies behind the end is never read. */
#ifndef GT_SCAN_H
#define GT_SCAN_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_scanner {
    const uint8_t *data;
    uint32_t at;
    uint32_t end;
} gt_scanner;

/* A piece of the datagram, from `at` to before `end`. */
typedef struct gt_piece {
    uint32_t at;
    uint32_t end;
} gt_piece;

/* The byte at the scanner, 0 behind the end. */
uint8_t gt_scan_here(const gt_scanner *s);

/* 1 and past the byte, if it is this one. */
int gt_scan_over(gt_scanner *s, char byte);

/* On to the next such byte, or to the end. */
void gt_scan_to(gt_scanner *s, char byte);

void gt_scan_spaces(gt_scanner *s);

/* Behind "<!": 1 and past a comment, "--" up to the next "--", behind which stands ">"; 0 for anything else. */
int gt_scan_comment(gt_scanner *s);

/* Spaces and comments: 1 unless a comment does not end as one. */
int gt_scan_blank(gt_scanner *s);

/* Letters, digits and underscores; may be empty. */
gt_piece gt_scan_word(gt_scanner *s);

/* 1 if the piece is this text. */
int gt_scan_equals(const gt_scanner *s, gt_piece piece, const char *text);

/* ="value" or ='value', with spaces round the sign: 1 and the value. */
int gt_scan_quoted(gt_scanner *s, gt_piece *value);

#ifdef __cplusplus
}
#endif

#endif
