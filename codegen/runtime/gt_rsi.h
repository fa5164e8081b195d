/* KUKA RSI over UDP: what a controller sends every 4 or 12 ms, and the answer that it waits for inside the cycle.
 *
 * A scanner and a writer of XML for these telegrams only, without locale and without allocation. Positions and
 * external axes in mm, angles and joints in degrees; what is sent are corrections, absolute from the start pose.
 * Tested against simulators only, never against a controller.
 */
#ifndef GT_RSI_H
#define GT_RSI_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define GT_RSI_DIGITS 20U

/* Which elements a telegram held. */
#define GT_RSI_RIST 1U   /* actual Cartesian pose */
#define GT_RSI_RSOL 2U   /* commanded Cartesian pose */
#define GT_RSI_AIPOS 4U  /* actual joints */
#define GT_RSI_ASPOS 8U  /* commanded joints */
#define GT_RSI_EIPOS 16U /* actual external axes */
#define GT_RSI_ESPOS 32U /* commanded external axes */
#define GT_RSI_DELAY 64U
#define GT_RSI_IPOC 128U

typedef struct gt_rsi_robot {
    uint32_t present;      /* GT_RSI_..., added */
    uint32_t given[6];     /* of rist to espos_mm: bit n for the number n */
    double rist[6];        /* X Y Z [mm] A B C [deg] */
    double rsol[6];
    double aipos_deg[6];   /* A1 to A6 */
    double aspos_deg[6];
    double eipos_mm[6];    /* E1 to E6 */
    double espos_mm[6];
    uint32_t delay;        /* D: answers that came late */
    uint64_t ipoc;         /* time stamp [ms] */
    uint32_t ipoc_length;  /* its digits as they came, for the answer */
    uint8_t ipoc_text[GT_RSI_DIGITS];
} gt_rsi_robot;

/* The answer: corrections of joints, external axes and pose, and the controller's own IPOC. */
typedef struct gt_rsi_sensor {
    double ak_deg[6];
    double ek_mm[6];
    double rkorr[6]; /* X Y Z [mm] A B C [deg] */
    uint32_t ipoc_length;
    uint8_t ipoc_text[GT_RSI_DIGITS];
} gt_rsi_sensor;

/* Reads `length` bytes as a telegram of a controller. 1 and `robot`, or 0 for one that is cut, malformed, without
 * IPOC, or holds a number that is not decimal. What is read stands once and in <Rob> itself; nothing but spaces stands
 * before <Rob> and its prologue, and behind </Rob>. Elements and attributes that are not known are skipped; of closing
 * tags only those of Rob and IPOC are compared. */
int gt_rsi_read_robot(const uint8_t *data, uint32_t length, gt_rsi_robot *robot);

/* Writes the answer, numbers rounded to 1e-6; returns its length, 0 if it does not fit or a number is not finite or
 * not below 1e9. */
uint32_t gt_rsi_write_sensor(const gt_rsi_sensor *sensor, uint8_t *data, uint32_t capacity);

#ifdef __cplusplus
}
#endif

#endif
