/* gt_wire: see gt_wire.h. */
#include "gt_wire.h"

#include "gt_float.h"

#include <string.h>

#define GT_VARINT_BYTES 10U

uint8_t gt_byte_at(const uint8_t *data, uint32_t at, uint32_t end)
{
    return ((at < end) && (at < GT_DATAGRAM_MAX)) ? data[at] : 0U;
}

gt_reader gt_reader_of(const uint8_t *data, uint32_t length)
{
    gt_reader reader;

    reader.data = data;
    reader.at = 0U;
    reader.good = (length <= GT_DATAGRAM_MAX) ? 1 : 0;
    reader.end = (length <= GT_DATAGRAM_MAX) ? length : 0U;
    return reader;
}

/* 1 if `count` more bytes are there; otherwise the reader is at fault. */
static int gt_has(gt_reader *reader, uint64_t count)
{
    if (!reader->good || (reader->at > reader->end) || (count > (uint64_t)(reader->end - reader->at))) {
        reader->good = 0;
        return 0;
    }
    return 1;
}

int gt_read_field(gt_reader *reader, gt_field *field)
{
    uint64_t key;

    field->number = 0U;
    field->type = 0U;
    if (!reader->good || (reader->at >= reader->end)) {
        return 0;
    }
    key = gt_read_varint(reader);
    if (!reader->good || (key > UINT32_MAX) || ((key >> 3) == 0U)) {
        reader->good = 0;
        return 0;
    }
    field->number = (uint32_t)(key >> 3);
    field->type = (uint32_t)(key & 7U);
    return 1;
}

uint64_t gt_read_varint(gt_reader *reader)
{
    uint64_t value = 0U;
    uint32_t n;

    for (n = 0U; n < GT_VARINT_BYTES; n++) {
        uint8_t byte;

        if (!gt_has(reader, 1U)) {
            return 0U;
        }
        byte = gt_byte_at(reader->data, reader->at, reader->end);
        reader->at++;
        value |= ((uint64_t)(byte & 0x7FU)) << (7U * n);
        if ((byte & 0x80U) == 0U) {
            return value;
        }
    }
    reader->good = 0;
    return 0U;
}

double gt_read_double(gt_reader *reader)
{
    uint64_t bits = 0U;
    double value;
    uint32_t n;

    if (!gt_has(reader, 8U)) {
        return 0.0;
    }
    for (n = 0U; n < 8U; n++) {
        bits |= ((uint64_t)gt_byte_at(reader->data, reader->at + n, reader->end)) << (8U * n);
    }
    reader->at += 8U;
    (void)memcpy(&value, &bits, sizeof(value));
    return value;
}

gt_reader gt_read_bytes(gt_reader *reader)
{
    gt_reader inner = *reader;
    const uint64_t length = gt_read_varint(reader);

    inner.at = 0U;
    inner.end = 0U;
    inner.good = 0;
    if (gt_has(reader, length)) {
        inner.at = reader->at;
        inner.end = reader->at + (uint32_t)length;
        inner.good = 1;
        reader->at = inner.end;
    }
    return inner;
}

void gt_skip(gt_reader *reader, uint32_t type)
{
    uint64_t count = 0U;

    if (type == GT_WIRE_VARINT) {
        (void)gt_read_varint(reader);
    } else if (type == GT_WIRE_FIXED64) {
        count = 8U;
    } else if (type == GT_WIRE_FIXED32) {
        count = 4U;
    } else if (type == GT_WIRE_BYTES) {
        count = gt_read_varint(reader);
    } else {
        reader->good = 0;
    }
    if (gt_has(reader, count)) {
        reader->at += (uint32_t)count;
    }
}

gt_writer gt_writer_of(uint8_t *data, uint32_t capacity)
{
    gt_writer writer;

    writer.data = data;
    writer.at = 0U;
    writer.capacity = capacity;
    writer.good = 1;
    return writer;
}

void gt_write_byte(gt_writer *writer, uint8_t byte)
{
    if (!writer->good || (writer->at >= writer->capacity)) {
        writer->good = 0;
    } else {
        writer->data[writer->at] = byte;
        writer->at++;
    }
}

void gt_write_varint(gt_writer *writer, uint64_t value)
{
    uint64_t rest = value;

    while (rest >= 0x80U) {
        gt_write_byte(writer, (uint8_t)((rest & 0x7FU) | 0x80U));
        rest >>= 7;
    }
    gt_write_byte(writer, (uint8_t)rest);
}

void gt_write_key(gt_writer *writer, uint32_t number, uint32_t type)
{
    gt_write_varint(writer, (((uint64_t)number) << 3) | type);
}

void gt_write_varint_field(gt_writer *writer, uint32_t number, uint64_t value)
{
    gt_write_key(writer, number, GT_WIRE_VARINT);
    gt_write_varint(writer, value);
}

void gt_write_double_field(gt_writer *writer, uint32_t number, double value)
{
    uint64_t bits;
    uint32_t n;

    (void)memcpy(&bits, &value, sizeof(bits));
    gt_write_key(writer, number, GT_WIRE_FIXED64);
    for (n = 0U; n < 8U; n++) {
        gt_write_byte(writer, (uint8_t)((bits >> (8U * n)) & 0xFFU));
    }
}

void gt_write_message(gt_writer *writer, uint32_t number, uint32_t length)
{
    gt_write_key(writer, number, GT_WIRE_BYTES);
    gt_write_varint(writer, length);
}

uint32_t gt_size_varint(uint64_t value)
{
    uint64_t rest = value;
    uint32_t size = 1U;

    while (rest >= 0x80U) {
        rest >>= 7;
        size++;
    }
    return size;
}

uint32_t gt_size_message(uint32_t length)
{
    return 1U + gt_size_varint(length) + length;
}
