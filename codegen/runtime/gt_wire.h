/* Bounded reading and writing of bytes: little-endian doubles and the varints and fields of protobuf's wire format.
 *
 * Positions are indices below a length that was checked; nothing is read or written outside it. A reader or writer
 * that met a fault stays at `good` == 0 and gives zeros, so that a caller may test once, at the end.
 */
#ifndef GT_WIRE_H
#define GT_WIRE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The longest datagram that is read or written [bytes]. */
#define GT_DATAGRAM_MAX 1400U

/* Wire types of protobuf; groups (3 and 4) are refused. */
#define GT_WIRE_VARINT 0U
#define GT_WIRE_FIXED64 1U
#define GT_WIRE_BYTES 2U
#define GT_WIRE_FIXED32 5U

typedef struct gt_reader {
    const uint8_t *data; /* GT_DATAGRAM_MAX bytes at least */
    uint32_t at;         /* next byte to read */
    uint32_t end;        /* first byte that is not to be read */
    int good;            /* 0 after a fault */
} gt_reader;

typedef struct gt_writer {
    uint8_t *data;
    uint32_t at;       /* next byte to write */
    uint32_t capacity; /* first byte that is not to be written */
    int good;          /* 0 after a fault */
} gt_writer;

/* A field of a message: its number, its wire type. */
typedef struct gt_field {
    uint32_t number;
    uint32_t type;
} gt_field;

/* The byte at an index below `end`, 0 behind it and behind GT_DATAGRAM_MAX: safe by its own test, whoever calls. */
uint8_t gt_byte_at(const uint8_t *data, uint32_t at, uint32_t end);

/* A reader of `length` bytes at `data`; more than GT_DATAGRAM_MAX is a fault. */
gt_reader gt_reader_of(const uint8_t *data, uint32_t length);

/* 1 and the next field's key in `field`; 0 at the end of the message and after a fault. */
int gt_read_field(gt_reader *reader, gt_field *field);

/* Seven bits per byte, lowest first; ten bytes at the most, of which the last counts one bit. */
uint64_t gt_read_varint(gt_reader *reader);

/* Eight bytes, lowest first, as a double. */
double gt_read_double(gt_reader *reader);

/* The bytes of a field of type GT_WIRE_BYTES as a reader of their own; `reader` goes on behind them. */
gt_reader gt_read_bytes(gt_reader *reader);

/* Goes on behind the value of a field of this wire type. */
void gt_skip(gt_reader *reader, uint32_t type);

/* A writer into `capacity` bytes at `data`. */
gt_writer gt_writer_of(uint8_t *data, uint32_t capacity);

void gt_write_byte(gt_writer *writer, uint8_t byte);
void gt_write_varint(gt_writer *writer, uint64_t value);
void gt_write_key(gt_writer *writer, uint32_t number, uint32_t type);

/* A field that is one varint. */
void gt_write_varint_field(gt_writer *writer, uint32_t number, uint64_t value);

/* A field that is one double. */
void gt_write_double_field(gt_writer *writer, uint32_t number, double value);

/* Key and length of an embedded message of `length` bytes, which the caller writes next. */
void gt_write_message(gt_writer *writer, uint32_t number, uint32_t length);

/* Bytes of a varint, and of a field that is one varint, one double, or a message of `length` bytes; field numbers
 * below 16. */
uint32_t gt_size_varint(uint64_t value);
uint32_t gt_size_message(uint32_t length);
#define GT_SIZE_DOUBLE_FIELD 9U

#ifdef __cplusplus
}
#endif

#endif
