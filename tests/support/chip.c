/* SPDX-License-Identifier: Apache-2.0 */
/* The board on a simulated chip: simavr runs the binary of the firmware, and this is what is wired
 * to the chip: multiplexers, fabric, the ADC's input, a serial line. chip.py loads it. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>

DEFINE_FIFO(uint16_t, uart_fifo);

#define LINES 16         /* channels of a multiplexer */
#define DDRB 0x24        /* data space */
#define DDRD 0x2A
#define F_CPU 16000000
#define ADC_STEPS 1024   /* of the supply: the largest reading is one less */
#define SCALE 32         /* of what simavr calls millivolts, so that it rounds nothing */
#define OCR0A 0x47
#define MCUSR 0x54
#define ADCSRA 0x7A
#define BUFFER (1 << 16)
#define RESTART_CYCLES 16000 /* without a conversion: the program began anew */
#define BEGINNING 3 /* conversions that are not measured: the first is not of a crossing */
#define NEVER ((avr_cycle_count_t)1 << 60)

struct chip {
    avr_t *avr;
    avr_uart_t *uart;
    avr_irq_t *adc, *line;
    double ratio[LINES][LINES]; /* of the supply that a crossing reads when it has settled */
    double tau;                 /* cycles */
    double noise;               /* RMS, ADC steps */
    uint32_t seed;
    uint32_t byte_cycles;       /* that the line takes for a byte */
    uint8_t row, col;
    double level, target;       /* at the last switch, and where it goes */
    avr_cycle_count_t switched, started;
    avr_cycle_count_t hold; /* from the begin of a conversion until the multiplexers may switch */
    /* what is measured */
    uint64_t conversions;
    uint64_t least_settling, least_hold; /* cycles */
    int64_t early, late;                 /* of a conversion against its tick, at most, cycles */
    avr_cycle_count_t first;             /* conversion that these are counted from */
    uint32_t begun;                      /* conversions since the start */
    /* the serial line */
    avr_cycle_count_t shifted; /* when the last byte that was written is out */
    uint8_t sent[BUFFER];
    uint32_t n_sent;
    uint8_t waiting[BUFFER];
    uint32_t n_waiting, n_taken, overruns;
    avr_cycle_count_t next_byte;
};

static void quiet(avr_t *avr, const int level, const char *format, va_list arguments)
{
    (void)avr;
    if (level == LOG_ERROR)
        vfprintf(stderr, format, arguments);
}

/* Four bytes of xorshift32, summed: all but normal, and the same on any simulator. */
static double noise(struct chip *chip)
{
    uint32_t x = chip->seed;
    x ^= x << 13;
    x ^= x >> 17;
    x ^= x << 5;
    chip->seed = x;
    double sum = (x & 255) + (x >> 8 & 255) + (x >> 16 & 255) + (x >> 24);
    return (sum - 510.0) / 147.8;
}

static double level_at(struct chip *chip, avr_cycle_count_t when)
{
    double passed = when - chip->switched;
    return chip->target + (chip->level - chip->target) * exp(-passed / chip->tau);
}

static void select_crossing(struct chip *chip)
{
    avr_t *avr = chip->avr;
    chip->level = level_at(chip, avr->cycle);
    chip->switched = avr->cycle;
    chip->target = chip->ratio[chip->row][chip->col];
}

static void least(uint64_t *value, uint64_t candidate)
{
    if (candidate < *value)
        *value = candidate;
}

/* A port was written. Both together are where the multiplexers stand. */
static void on_port(struct avr_irq_t *irq, uint32_t value, void *parameter)
{
    struct chip *chip = parameter;
    avr_t *avr = chip->avr;
    uint8_t is_row = irq == avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), IOPORT_IRQ_REG_PORT);
    uint8_t pins = is_row ? value & avr->data[DDRB] & 15 : (value & avr->data[DDRD]) >> 4;
    *(is_row ? &chip->row : &chip->col) = pins;
    avr_cycle_count_t held = avr->cycle - chip->started;
    if (held < chip->hold) /* too early: the ADC reads neither this crossing nor that */
        avr_raise_irq(chip->adc + ADC_IRQ_ADC0, 0);
    if (chip->begun > BEGINNING)
        least(&chip->least_hold, held);
    select_crossing(chip);
}

/* A conversion begins: what it will read. */
static void on_conversion(struct avr_irq_t *irq, uint32_t value, void *parameter)
{
    (void)irq, (void)value;
    struct chip *chip = parameter;
    avr_cycle_count_t now = chip->avr->cycle;
    uint8_t clock = 1 << (chip->avr->data[ADCSRA] & 7); /* of the ADC, cycles */
    chip->hold = 5 * clock / 2; /* 1.5 clocks, and the wait for an edge */
    double steps = level_at(chip, now + 3 * clock / 2) * ADC_STEPS + 0.5;
    if (chip->noise > 0.0)
        steps += chip->noise * noise(chip);
    uint32_t reading = steps < 0.0 ? 0 : steps >= ADC_STEPS ? ADC_STEPS - 1 : (uint32_t)steps;
    avr_raise_irq(chip->adc + ADC_IRQ_ADC0, reading * SCALE + SCALE / 2);
    if (now - chip->started > RESTART_CYCLES)
        chip->begun = 0;
    chip->started = now;
    chip->conversions++;
    if (chip->begun++ < BEGINNING) {
        chip->first = now;
        return;
    }
    least(&chip->least_settling, now - chip->switched);
    int64_t tick = chip->avr->data[OCR0A] + 1;
    int64_t off = (int64_t)(now - chip->first + tick / 2) % tick - tick / 2;
    chip->early = off < chip->early ? off : chip->early;
    chip->late = off > chip->late ? off : chip->late;
}

static avr_cycle_count_t buffer_is_empty(avr_t *avr, avr_cycle_count_t when, void *parameter)
{
    (void)when;
    struct chip *chip = parameter;
    avr_regbit_set(avr, chip->uart->udrc.raised);
    chip->uart->cycles_per_byte = chip->byte_cycles; /* received bytes are simavr's */
    return 0;
}

/* A byte was written. The chip has a shift register and a buffer before it, simavr only one of them
 * (and a parity bit that is not there): when the buffer is empty is told from here. */
static void on_byte(struct avr_irq_t *irq, uint32_t value, void *parameter)
{
    (void)irq;
    struct chip *chip = parameter;
    avr_t *avr = chip->avr;
    chip->uart->cycles_per_byte = NEVER;
    avr_cycle_count_t shifted = chip->shifted > avr->cycle ? chip->shifted : avr->cycle;
    chip->shifted = shifted + chip->byte_cycles;
    avr_cycle_timer_register(avr, shifted - avr->cycle + 1, buffer_is_empty, chip);
    if (chip->n_sent < BUFFER)
        chip->sent[chip->n_sent++] = (uint8_t)value;
}

struct chip *chip_new(const char *path, double tau, double rms, uint32_t seed)
{
    avr_global_logger_set(quiet);
    elf_firmware_t firmware = {0};
    struct chip *chip = calloc(1, sizeof *chip);
    if (!chip || elf_read_firmware(path, &firmware))
        goto failed;
    strcpy(firmware.mmcu, "atmega328p");
    firmware.frequency = F_CPU;
    avr_t *avr = chip->avr = avr_make_mcu_by_name(firmware.mmcu);
    if (!avr || avr_init(avr))
        goto failed;
    avr_load_firmware(avr, &firmware);
    avr->vcc = avr->avcc = avr->aref = (ADC_STEPS - 1) * SCALE;
    chip->tau = tau;
    chip->noise = rms;
    chip->seed = seed ? seed : 1;
    chip->byte_cycles = F_CPU / 100000;
    chip->least_settling = chip->least_hold = UINT64_MAX;
    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "uart"))
            chip->uart = (avr_uart_t *)io;
    uint32_t flags = 0; /* neither sleep while it is polled, nor print what is sent */
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    chip->adc = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, 0);
    chip->line = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), 0);
    for (char port = 'B'; port <= 'D'; port += 2)
        avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(port), IOPORT_IRQ_REG_PORT),
                                on_port, chip);
    avr_irq_register_notify(chip->adc + ADC_IRQ_OUT_TRIGGER, on_conversion, chip);
    avr_irq_register_notify(chip->line + UART_IRQ_OUTPUT, on_byte, chip);
    return chip;
failed:
    free(chip);
    return NULL;
}

void chip_free(struct chip *chip)
{
    avr_terminate(chip->avr);
    free(chip);
}

/* What each crossing reads from now on, as a share of the supply. */
void chip_feel(struct chip *chip, const double *ratio)
{
    memcpy(chip->ratio, ratio, sizeof chip->ratio);
    select_crossing(chip);
}

/* Bytes that will arrive, one after the other; what its three bytes of buffer cannot take is lost. */
void chip_receive(struct chip *chip, const uint8_t *bytes, uint32_t n)
{
    if (chip->n_taken == chip->n_waiting)
        chip->n_taken = chip->n_waiting = 0;
    for (uint32_t k = 0; k < n && chip->n_waiting < BUFFER; k++)
        chip->waiting[chip->n_waiting++] = bytes[k];
}

static void arrive(struct chip *chip)
{
    avr_t *avr = chip->avr;
    if (chip->n_taken == chip->n_waiting || avr->cycle < chip->next_byte)
        return;
    chip->next_byte = avr->cycle + chip->byte_cycles;
    uint8_t byte = chip->waiting[chip->n_taken++];
    if (uart_fifo_get_read_size(&chip->uart->input) >= 3)
        chip->overruns++;
    else
        avr_raise_irq(chip->line + UART_IRQ_INPUT, byte);
}

/* Let so many cycles pass; whether the chip still runs. */
int chip_run(struct chip *chip, uint64_t cycles)
{
    avr_t *avr = chip->avr;
    avr_cycle_count_t end = avr->cycle + cycles;
    while (avr->cycle < end) {
        arrive(chip);
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed)
            return 0;
    }
    return 1;
}

/* The bytes sent since the last call: how many were copied. */
uint32_t chip_sent(struct chip *chip, uint8_t *bytes)
{
    uint32_t n = chip->n_sent;
    memcpy(bytes, chip->sent, n);
    chip->n_sent = 0;
    return n;
}

/* As the reset pin, a brown-out or the power does: `cause` is the bit of MCUSR. */
void chip_reset(struct chip *chip, uint8_t cause)
{
    avr_t *avr = chip->avr;
    avr_reset(avr);
    avr->data[MCUSR] |= cause;
    chip->row = chip->col = 0;
    chip->begun = 0;
    chip->n_waiting = chip->n_taken = 0;
    select_crossing(chip);
}

/* The program runs astray into a loop that never ends, with interrupts off: `cli; rjmp .`. */
int chip_hang(struct chip *chip)
{
    avr_t *avr = chip->avr;
    for (uint32_t at = 0; at + 1 < avr->flashend; at += 2)
        if (avr->flash[at] == 0xFF && avr->flash[at + 1] == 0xCF) {
            avr->pc = at;
            return 1;
        }
    return 0;
}

void chip_set_byte_cycles(struct chip *chip, uint32_t cycles)
{
    chip->byte_cycles = cycles;
}

/* Cycles, conversions, least settling, least hold, most early and late, bytes that were lost. */
void chip_measured(struct chip *chip, int64_t *values)
{
    int64_t all[] = {chip->avr->cycle,  chip->conversions, chip->least_settling, chip->least_hold,
                     chip->early,       chip->late,        chip->overruns};
    memcpy(values, all, sizeof all);
}
