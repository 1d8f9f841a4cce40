/* SPDX-License-Identifier: Apache-2.0 */
/* What is wired to what, and why each number is what it is.
 *
 *   ATmega328P  Nano       wired to
 *   PB0 .. PB3  D8 .. D11  S0 .. S3 of the multiplexer of the rows; its common pin to +5 V
 *   PD4 .. PD7  D4 .. D7   S0 .. S3 of the multiplexer of the columns; its common pin to PC0
 *   PC0         A0         the common pin of the columns, and R_ref to ground
 *   PD0, PD1    RX, TX     USB converter
 *   AREF        AREF       100 nF to ground; the ADC's reference is the supply
 *
 * /E of both multiplexers is at ground. A multiplexer connects one line and leaves the others
 * floating, as the circuit model assumes. */
#ifndef BOARD_H
#define BOARD_H

#ifndef ROWS
#define ROWS 16
#endif
#ifndef COLS
#define COLS 16
#endif
#define CELLS (ROWS * COLS)

#if ROWS < 1 || ROWS > 16 || COLS < 1 || COLS > 16
#error "a multiplexer of 16 channels: ROWS and COLS must be from 1 to 16"
#endif

#define select_row(row) (PORTB = (row))
#define select_col(col) (PORTD = (uint8_t)((col) << 4) | PULL_UPS)
#define ROW_PINS 0x0F /* of port B */
#define COL_PINS 0xF0 /* of port D */
#define PULL_UPS 0x0D /* of port D: RX and the two free pins must not float */

/* The clock of the ADC [MHz], 2 or 1. A conversion takes 13 clocks: 6.5 us at 2 MHz, so that a crossing
 * can be read every 10 us, 100,000 a second, as in the paper. The data sheet ends at 1 MHz, where a
 * reading is wrong by up to 4.5 steps (docs/board.md says what that costs): with that clock a crossing
 * is read every 16 us, and up to 80 frames a second are sent. */
#ifndef ADC_MHZ
#define ADC_MHZ 2
#endif
#if ADC_MHZ == 2
#define ADC_PRESCALER (_BV(ADPS1) | _BV(ADPS0))
#define TICK_CYCLES 160
#elif ADC_MHZ == 1
#define ADC_PRESCALER _BV(ADPS2)
#define TICK_CYCLES 256
#else
#error "ADC_MHZ must be 2 or 1"
#endif
#define ADC_BITS 10
#define ADC_CLOCK_CYCLES (16 / ADC_MHZ)
#define TICK_US (TICK_CYCLES / 16)

/* The input is held 1.5 ADC clocks after a conversion begins, which is at the next edge of the ADC's
 * clock, up to one more; from then on the multiplexers may switch. One more clock to be sure. */
#define HOLD_CYCLES (7 * ADC_CLOCK_CYCLES / 2)

/* From a switch to the next conversion, at least: 4 us. The slowest node is the ADC's input: R_ref,
 * 1.78 kohm, with 150 pF of multiplexers, wires and chip is 0.27 us; to half a step of 10 bits takes
 * 7.6 times that, 2.0 us. The floating lines charge through the fabric: 16 cells of 40 kohm side by
 * side are 2.5 kohm, with 100 pF of a stripe as much. It is what the order of the work in a tick
 * leaves, so it is tested and not waited for. */
#define SETTLE_CYCLES 64

/* After the last crossing: one to take its reading, two for the frame, commands and watchdog. */
#define REST_TICKS 3
#define SCAN_TICKS (CELLS + REST_TICKS)
#define SCAN_US (SCAN_TICKS * TICK_US)

#define DEFAULT_RATE 100  /* frames a second, paper section III-B */
#define DEFAULT_FILTER 3  /* eighths: in noise like a mean of 4 scans, 5 ms behind */

#endif
