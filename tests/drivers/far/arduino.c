/* arduino BOOTLOADER.hex: an ATmega328P at 16 MHz that has just been reset, run by simavr no faster than a real one.
 * Its serial port is standard input and output. It ends when its input does. */
#include <fcntl.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_hex.h>

enum { frequency = 16000000, cycles_a_look = frequency / 1000, mcusr = 0x54, external_reset = 1 << 1 };

static int may_take = 1; /* whether the serial port has room for another byte */

static void on_xon(struct avr_irq_t *irq, uint32_t value, void *parameter)
{
    may_take = 1;
}

static void on_xoff(struct avr_irq_t *irq, uint32_t value, void *parameter)
{
    may_take = 0;
}

static void on_output(struct avr_irq_t *irq, uint32_t value, void *parameter)
{
    uint8_t byte = value;
    if (write(STDOUT_FILENO, &byte, 1) != 1)
        exit(0);
}

static void connect_port(avr_t *avr)
{
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_output, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_xon, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_xoff, NULL);
}

/* Gives the chip what has come; 0 at the end of the input. */
static int take_input(avr_t *avr)
{
    avr_irq_t *input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    while (may_take) {
        struct pollfd ready = {.fd = STDIN_FILENO, .events = POLLIN};
        uint8_t byte;
        if (poll(&ready, 1, 0) <= 0)
            return 1;
        if (read(STDIN_FILENO, &byte, 1) != 1)
            return 0;
        avr_raise_irq(input, byte);
    }
    return 1;
}

static int64_t now_us(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * INT64_C(1000000) + now.tv_nsec / 1000;
}

static void run(avr_t *avr)
{
    int64_t begin = now_us();
    avr_cycle_count_t next_look = 0;
    for (;;) {
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed)
            return;
        if (avr->cycle < next_look)
            continue;
        next_look = avr->cycle + cycles_a_look;
        if (!take_input(avr))
            return;
        int64_t ahead = (int64_t)(avr->cycle / (frequency / 1000000)) - (now_us() - begin);
        if (ahead > 0)
            usleep(ahead);
        else
            begin -= ahead; /* what a busy machine has lost is not made up for in a hurry */
    }
}

int main(int argc, char **argv)
{
    uint32_t size = 0, start = 0;
    uint8_t *boot = argc == 2 ? read_ihex_file(argv[1], &size, &start) : NULL;
    avr_t *avr = avr_make_mcu_by_name("atmega328p");
    if (!boot || !avr) {
        fprintf(stderr, "usage: arduino BOOTLOADER.hex\n");
        return 2;
    }
    avr_init(avr);
    avr->log = LOG_NONE;
    avr->frequency = frequency;
    memset(avr->flash, 0xFF, avr->flashend + 1);
    memcpy(avr->flash + start, boot, size);
    avr->pc = start;
    avr->codeend = avr->flashend;
    avr->data[mcusr] = external_reset;
    connect_port(avr);
    run(avr);
    return 0;
}
