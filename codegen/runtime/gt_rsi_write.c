/* The answer to an RSI controller; see gt_rsi.h. */
#include "gt_rsi.h"

#include "gt_decimal.h"
#include "gt_wire.h"

static void gt_write_text(gt_writer *writer, const char *text)
{
    uint32_t n;

    for (n = 0U; text[n] != '\0'; n++) {
        gt_write_byte(writer, (uint8_t)text[n]);
    }
}

/* <NAME A1="..." ... A6="..."/>; `names` are pairs of characters, the second of which may be a space. */
static void gt_write_six(gt_writer *writer, const char *element, const char *names, const double *values)
{
    uint32_t n;

    gt_write_text(writer, "<");
    gt_write_text(writer, element);
    for (n = 0U; n < 6U; n++) {
        gt_write_text(writer, " ");
        gt_write_byte(writer, (uint8_t)names[2U * n]);
        if (names[(2U * n) + 1U] != ' ') {
            gt_write_byte(writer, (uint8_t)names[(2U * n) + 1U]);
        }
        gt_write_text(writer, "=\"");
        gt_write_decimal(writer, values[n]);
        gt_write_text(writer, "\"");
    }
    gt_write_text(writer, "/>");
}

uint32_t gt_rsi_write_sensor(const gt_rsi_sensor *sensor, uint8_t *data, uint32_t capacity)
{
    gt_writer writer = gt_writer_of(data, capacity);
    uint32_t n;

    gt_write_text(&writer, "<Sen Type=\"ImFree\">");
    gt_write_six(&writer, "AK", "A1A2A3A4A5A6", sensor->ak_deg);
    gt_write_six(&writer, "EK", "E1E2E3E4E5E6", sensor->ek_mm);
    gt_write_six(&writer, "RKorr", "X Y Z A B C ", sensor->rkorr);
    gt_write_text(&writer, "<IPOC>");
    for (n = 0U; (n < sensor->ipoc_length) && (n < GT_RSI_DIGITS); n++) {
        gt_write_byte(&writer, sensor->ipoc_text[n]);
    }
    gt_write_text(&writer, "</IPOC></Sen>");
    return writer.good ? writer.at : 0U;
}
