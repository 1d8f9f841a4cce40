/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the skin 386 times a second, low-passes each crossing, and sends frames.
 *
 * There are no interrupts: all happens in one loop of ticks of 10 us, which is also the time of a byte
 * on the serial line. A tick begins a conversion, filters the reading of the tick before while the
 * input is being held, switches the multiplexers to the next crossing, and sends or receives a byte.
 * An interrupt for the line would come between a switch and the next conversion at times, and cost 30
 * cycles of 160 to enter and leave; so nothing delays a conversion, and all crossings settle as long. */
#include <avr/io.h>
#include <avr/wdt.h>
#include <stddef.h>
#include <util/crc16.h>

#include "board.h"
#include "protocol.h"

#define FRACTION_BITS 6 /* of the low-pass; with 10 bits of the ADC they fill a word */
#define MICROSECONDS 1000000UL
#define TAKE_CYCLES 28 /* that `take` takes at least; a test measures it */

_Static_assert(ADC_BITS + FRACTION_BITS == 16, "the left-adjusted result is the sample");
_Static_assert(HOLD_CYCLES + SETTLE_CYCLES <= TICK_CYCLES, "a tick is too short to settle");

static struct skin {
    uint16_t filtered[CELLS]; /* ADC steps * 2^FRACTION_BITS */
    struct {
        struct header header;
        uint16_t header_crc;
        uint16_t samples[CELLS];
        uint16_t crc;
    } frame;
} skin;
#define SAMPLE_OF offsetof(struct skin, frame.samples) /* bytes from a cell's low-pass to it */

static const struct header first_header = {
    .magic = {FRAME_MAGIC_0, FRAME_MAGIC_1},
    .version = PROTOCOL_VERSION,
    .rows = ROWS,
    .cols = COLS,
    .adc_bits = ADC_BITS,
    .fraction_bits = FRACTION_BITS,
};

static struct description description = {
    .magic = {DESCRIPTION_MAGIC_0, DESCRIPTION_MAGIC_1},
    .version = PROTOCOL_VERSION,
    .firmware = FIRMWARE_VERSION,
    .rows = ROWS,
    .cols = COLS,
    .adc_bits = ADC_BITS,
    .fraction_bits = FRACTION_BITS,
    .rate = DEFAULT_RATE,
    .filter = DEFAULT_FILTER,
    .scan_us = SCAN_US,
};

/* --- serial line ----------------------------------------------------------------------------- */

static uint8_t *next, *end; /* of what is being sent */
static uint8_t *crc_at;     /* where the next CRC belongs */
static uint16_t crc;        /* of the bytes sent */
static struct command received;
static uint8_t n_received;

static inline void begin(void *message, void *first_crc, uint16_t size)
{
    next = message;
    end = next + size;
    crc_at = first_crc;
    crc = CRC_START;
}

/* One byte, of one direction: more do not fit into a tick. */
static inline void serve_line(void)
{
    uint8_t status = UCSR0A;
    if (status & _BV(RXC0)) {
        uint8_t byte = UDR0;
        if (n_received < sizeof received && (n_received || byte == COMMAND_MAGIC))
            ((uint8_t *)&received)[n_received++] = byte;
    } else if (status & _BV(UDRE0)) {
        uint8_t *at = next;
        if (at == end)
            return;
        if (at == crc_at) {
            at[0] = (uint8_t)crc;
            at[1] = crc >> 8;
            crc_at = end - sizeof crc;
        }
        uint8_t byte = *at++;
        UDR0 = byte;
        crc = _crc_xmodem_update(crc, byte);
        next = at;
    }
}

/* --- scan ------------------------------------------------------------------------------------ */

static inline void wait_for_tick(void)
{
    loop_until_bit_is_set(TIFR0, OCF0A);
    TIFR0 = _BV(OCF0A);
}

/* The result of the tick before; its conversion has ended by far, unless that tick was late. */
static inline uint16_t converted(void)
{
    loop_until_bit_is_clear(ADCSRA, ADSC);
    return ADC;
}

/* One instruction; C would multiply 16 bits, and be late for the next tick. */
static inline uint16_t product(uint8_t a, uint8_t b)
{
    uint16_t result;
    __asm__("mul %1, %2\n\tmovw %0, r0\n\tclr __zero_reg__" : "=r"(result) : "r"(a), "r"(b) : "r0");
    return result;
}

/* value * weight / 256 */
static inline uint16_t share(uint16_t value, uint8_t weight)
{
    return product(value >> 8, weight) + (product((uint8_t)value, weight) >> 8);
}

/* What is done with this scan, in a register whose bits are tested in one cycle: the low-pass begins
 * with it; it goes into the frame; unfiltered. */
#define scan_flags GPIOR0
enum { RESTART = 1, KEEP = 2, RAW = 4 };

/* A reading into the low-pass: y += weight (x - y); and into the frame, if this scan is sent. */
static inline void take(uint16_t *filtered, uint16_t x, uint8_t weight)
{
    uint16_t y = *filtered;
    if (x > y)
        y += share(x - y, weight);
    else
        y -= share(y - x, weight);
    if (scan_flags & RESTART)
        y = x;
    *filtered = y;
    if (scan_flags & KEEP)
        *(uint16_t *)((uint8_t *)filtered + SAMPLE_OF) = (scan_flags & RAW) ? x : y;
}

/* Read all crossings once; the first is selected, and is again at the end. */
static void scan(void)
{
    uint8_t weight = (uint8_t)(description.filter << 5); /* eighths -> 1/256; 8 restarts instead */
    uint16_t *y = NULL; /* of the last tick's crossing */
    for (uint8_t row = 0; row < ROWS; row++) {
        for (uint8_t col = 1; col <= COLS; col++) { /* the next one */
            wait_for_tick();
            uint16_t reading = converted();
            ADCSRA = _BV(ADEN) | _BV(ADSC) | ADC_PRESCALER;
            if (y) {
                take(y++, reading, weight);
                if (HOLD_CYCLES > TAKE_CYCLES)
                    __builtin_avr_delay_cycles(HOLD_CYCLES - TAKE_CYCLES);
            } else {
                __builtin_avr_delay_cycles(HOLD_CYCLES);
                y = skin.filtered;
            }
            if (col < COLS) {
                select_col(col);
            } else {
                select_row(row + 1 < ROWS ? row + 1 : 0);
                select_col(0);
            }
            serve_line();
        }
    }
    wait_for_tick();
    take(y, converted(), weight);
    serve_line();
}

/* --- between two scans ----------------------------------------------------------------------- */

static uint32_t now; /* us */
static uint16_t sequence; /* of the next frame */
static uint32_t credit; /* millionths of a frame that are due */
static uint8_t describe = 1, raw;

static void obey(void)
{
    if (n_received < sizeof received)
        return;
    n_received = 0;
    uint16_t sum = CRC_START;
    for (uint8_t k = 0; k < sizeof received - sizeof sum; k++)
        sum = _crc_xmodem_update(sum, ((uint8_t *)&received)[k]);
    uint8_t value = received.value;
    if (sum != received.crc)
        return;
    switch (received.code) {
    case COMMAND_RATE:
        if (value >= MIN_RATE && value <= MAX_RATE)
            description.rate = value;
        break;
    case COMMAND_FILTER:
        if (value >= MIN_FILTER && value <= MAX_FILTER)
            description.filter = value;
        break;
    case COMMAND_RAW:
        raw = RAW;
        break;
    }
    describe = 1;
}

/* Begin to send what is due, and say what is to be done with the next scan. */
static void rest(void)
{
    now += SCAN_US;
    credit += (uint16_t)SCAN_US * (uint32_t)description.rate;
    if (scan_flags & KEEP) {
        if (next != end) { /* received bytes held it up: the scan has overtaken what is being sent */
            crc = ~crc; /* so that it does not pass for a frame */
        } else {
            skin.frame.header.sequence = sequence++;
            skin.frame.header.device_time = now;
            begin(&skin.frame, &skin.frame.header_crc, sizeof skin.frame);
        }
    }
    obey();
    if (describe && next == end) {
        describe = 0;
        begin(&description, &description.crc, sizeof description);
    }
    uint8_t flags = description.filter == MAX_FILTER ? RESTART : 0;
    /* The scan may fill the frame behind the byte that is sent: two bytes a tick, one leaves. */
    if (credit >= MICROSECONDS && end - next < (int)sizeof skin.frame / 4) {
        credit -= MICROSECONDS;
        if (credit >= MICROSECONDS)
            credit = 0;
        flags |= KEEP | raw;
        raw = 0;
    }
    scan_flags = flags;
    wdt_reset();
}

static void start(void)
{
    description.reset_cause = MCUSR;
    MCUSR = 0; /* else a reset by the watchdog would leave it running at 15 ms */
    wdt_enable(WDTO_60MS);
    skin.frame.header = first_header;
    DDRB = ROW_PINS;
    DDRD = COL_PINS;
    select_row(0);
    select_col(0);
    DIDR0 = _BV(ADC0D);
    ADMUX = _BV(REFS0) | _BV(ADLAR); /* the supply as reference, channel 0 */
    ADCSRA = _BV(ADEN) | ADC_PRESCALER;
    UCSR0A = 0;  /* a boot loader may have left the double speed on */
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);  /* 8 bits, no parity, 1 stop bit */
    UBRR0 = F_CPU / 16 / BAUD - 1;
    UCSR0B = _BV(RXEN0) | _BV(TXEN0);
    TCCR0A = _BV(WGM01); /* count to OCR0A, and begin again */
    OCR0A = TICK_CYCLES - 1;
    TCCR0B = _BV(CS00);
    /* the first conversion takes 25 clocks */
    ADCSRA |= _BV(ADSC);
    loop_until_bit_is_clear(ADCSRA, ADSC);
    wait_for_tick(); /* one that has passed */
}

int main(void)
{
    start();
    scan_flags = RESTART;
    for (;;) {
        scan();
        wait_for_tick();
        rest(); /* in less than two ticks */
        wait_for_tick();
    }
}
