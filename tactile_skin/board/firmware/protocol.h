/* SPDX-License-Identifier: Apache-2.0 */
/* The bytes on the serial line, as in ../protocol.py and ../description.py: a test compares them.
 * Numbers of more than one byte are little-endian, as the ATmega328P keeps them. */
#ifndef PROTOCOL_H
#define PROTOCOL_H

#include <stdint.h>

#define BAUD 1000000UL /* exact at 16 MHz; a frame of 16 x 16, 529 bytes, takes 5.3 ms */

/* CRC-16/CCITT-FALSE: _crc_xmodem_update of avr-libc, started here */
#define CRC_START 0xFFFF

/* A frame: header, CRC of the header, samples row by row, CRC of all bytes before it. */
#define FRAME_MAGIC_0 0xA5
#define FRAME_MAGIC_1 0x5A
#define PROTOCOL_VERSION 1

struct header {
    uint8_t magic[2];
    uint8_t version; /* PROTOCOL_VERSION */
    uint8_t rows, cols;
    uint8_t adc_bits;
    uint8_t fraction_bits; /* what the low-pass adds below one ADC step */
    uint16_t sequence;     /* wraps */
    uint32_t device_time;  /* us, wraps */
};

/* What the board is: sent at the start, and as the answer to a command. */
#define DESCRIPTION_MAGIC_0 0xA5
#define DESCRIPTION_MAGIC_1 0xD5
#define FIRMWARE_VERSION 1

struct description {
    uint8_t magic[2];
    uint8_t version; /* PROTOCOL_VERSION */
    uint8_t firmware; /* FIRMWARE_VERSION */
    uint8_t rows, cols;
    uint8_t adc_bits;
    uint8_t fraction_bits;
    uint8_t rate;         /* frames a second */
    uint8_t filter;       /* eighths of a new reading that the low-pass takes */
    uint16_t scan_us;     /* one reading of all crossings */
    uint8_t reset_cause;  /* MCUSR: 1 power-on, 2 reset pin, 4 brown-out, 8 watchdog */
    uint16_t crc;         /* of all bytes before it */
};

/* What the board understands; a value out of range changes nothing. It answers by its description. */
#define COMMAND_MAGIC 0xC5
#define COMMAND_DESCRIBE 'd' /* value: any */
#define COMMAND_RATE 'r'     /* value: frames a second, MIN_RATE to MAX_RATE */
#define COMMAND_FILTER 'f'   /* value: eighths, 1 to 8; 8: no low-pass */
#define COMMAND_RAW 'u'      /* value: any; the next frame holds one unfiltered scan */
#define MIN_RATE 1
#define MAX_RATE 100
#define MIN_FILTER 1
#define MAX_FILTER 8

struct command {
    uint8_t magic; /* COMMAND_MAGIC */
    uint8_t code;
    uint8_t value;
    uint16_t crc; /* of all bytes before it */
};

#endif
