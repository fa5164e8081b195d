/* gt_decimal: see gt_decimal.h. */
#include "gt_decimal.h"

#include "gt_float.h"

#include <math.h>

#define GT_DIGITS_MOST 18U
#define GT_POWER_MOST 22
#define GT_EXPONENT_MOST 999U
#define GT_SCALE 1000000U
#define GT_WRITE_LIMIT 1.0e9

static int gt_is_digit(uint8_t byte)
{
    return (byte >= (uint8_t)'0') && (byte <= (uint8_t)'9');
}

/* [+-]digits behind the e; at most three digits */
static int gt_read_exponent(const uint8_t *data, uint32_t at, uint32_t end, int *exponent)
{
    uint32_t i = at;
    uint32_t digits = 0U;
    uint32_t value = 0U;
    int negative = 0;

    *exponent = 0;
    if ((i < end) && ((gt_byte_at(data, i, end) == (uint8_t)'+') || (gt_byte_at(data, i, end) == (uint8_t)'-'))) {
        negative = (gt_byte_at(data, i, end) == (uint8_t)'-') ? 1 : 0;
        i++;
    }
    while ((i < end) && (digits < 3U) && gt_is_digit(gt_byte_at(data, i, end))) {
        value = (10U * value) + ((uint32_t)gt_byte_at(data, i, end) - (uint32_t)'0');
        digits++;
        i++;
    }
    if ((digits == 0U) || (i != end) || (value > GT_EXPONENT_MOST)) {
        return 0;
    }
    *exponent = negative ? -(int)value : (int)value;
    return 1;
}

static double gt_scaled(double mantissa, int power)
{
    /* exact as doubles, so that one multiplication or division rounds once */
    static const double powers[GT_POWER_MOST + 1] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                                     1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                                     1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

    return (power < 0) ? (mantissa / powers[-power]) : (mantissa * powers[power]);
}

int gt_read_decimal(const uint8_t *data, uint32_t at, uint32_t end, double *value)
{
    uint32_t i = at;
    uint32_t seen = 0U; /* digits */
    uint32_t kept = 0U; /* of which in the mantissa, leading zeros apart */
    uint64_t mantissa = 0U;
    uint32_t places = 0U; /* of the mantissa behind the point */
    int power;
    int exponent = 0;
    int point = 0;
    int negative = 0;

    if ((i < end) && ((gt_byte_at(data, i, end) == (uint8_t)'+') || (gt_byte_at(data, i, end) == (uint8_t)'-'))) {
        negative = (gt_byte_at(data, i, end) == (uint8_t)'-') ? 1 : 0;
        i++;
    }
    while ((i < end) &&
           (gt_is_digit(gt_byte_at(data, i, end)) || ((gt_byte_at(data, i, end) == (uint8_t)'.') && !point))) {
        if (gt_byte_at(data, i, end) == (uint8_t)'.') {
            point = 1;
        } else {
            const uint32_t digit = (uint32_t)gt_byte_at(data, i, end) - (uint32_t)'0';

            seen++;
            if (kept < GT_DIGITS_MOST) {
                mantissa = (10U * mantissa) + digit;
                kept += (mantissa > 0U) ? 1U : 0U;
                if (point && (places < GT_DATAGRAM_MAX)) {
                    places++;
                }
            } else if (!point) {
                return 0;
            } else {
                /* below the eighteenth digit: cut off */
            }
        }
        i++;
    }
    if (seen == 0U) {
        return 0;
    }
    if ((i < end) && ((gt_byte_at(data, i, end) == (uint8_t)'e') || (gt_byte_at(data, i, end) == (uint8_t)'E'))) {
        if (!gt_read_exponent(data, i + 1U, end, &exponent)) {
            return 0;
        }
        i = end;
    }
    power = exponent - (int)places;
    if ((i != end) || (power < -GT_POWER_MOST) || (power > GT_POWER_MOST)) {
        return 0;
    }
    *value = gt_scaled((double)mantissa, power);
    if (negative) {
        *value = -*value;
    }
    return 1;
}

int gt_read_digits(const uint8_t *data, uint32_t at, uint32_t end, uint64_t *value)
{
    uint32_t i;

    *value = 0U;
    if ((at >= end) || ((end - at) > 19U)) {
        return 0;
    }
    for (i = at; i < end; i++) {
        if (!gt_is_digit(gt_byte_at(data, i, end))) {
            return 0;
        }
        *value = (10U * *value) + ((uint64_t)gt_byte_at(data, i, end) - (uint64_t)'0');
    }
    return 1;
}

void gt_write_decimal(gt_writer *writer, double value)
{
    uint8_t digits[20];
    uint32_t count = 0U;
    uint64_t scaled;

    if (!(fabs(value) < GT_WRITE_LIMIT)) {
        writer->good = 0;
        return;
    }
    scaled = (uint64_t)floor((fabs(value) * (double)GT_SCALE) + 0.5);
    if ((value < 0.0) && (scaled > 0U)) {
        gt_write_byte(writer, (uint8_t)'-');
    }
    while ((scaled > 0U) || (count < 7U)) {
        digits[count] = (uint8_t)((uint64_t)'0' + (scaled % 10U));
        scaled /= 10U;
        count++;
    }
    while (count > 0U) {
        count--;
        gt_write_byte(writer, digits[count]);
        if (count == 6U) {
            gt_write_byte(writer, (uint8_t)'.');
        }
    }
}
