#include "board.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <sim_core.h>
#include <sim_elf.h>

#include "flags.h"
#include "memory.h"
#include "registers.h"

#define RAM_START 0x100
#define MCUSR_POWER_ON 0x01
#define MCUSR_EXTERNAL 0x02
#define MCUSR_WATCHDOG 0x08
#define SMCR_MODE 0x0e
#define INTERRUPT_ENTRY 4 /* cycles: data sheet 2593, section 6.7.1 */

double board_time_of(const board *b, double cycle)
{
    return b->origin + (cycle - (double)b->origin_cycle) * b->period;
}

double board_cycle_of(const board *b, double time)
{
    return (double)b->origin_cycle + (time - b->origin) * b->frequency;
}

static inline void keep_time(board *b)
{
    b->now = b->origin + (double)(int64_t)(b->avr->cycle - b->origin_cycle) * b->period;
}

/* What avr_reset leaves as simavr would have it, and we would not. */
static void mend_after_reset(board *b, uint8_t cause)
{
    avr_t *avr = b->avr;
    avr->run = b->run;
    avr->data[REG_MCUSR] = cause;
    extint_after_reset(b);
    pins_after_reset(b);
    capture_after_reset(b);
    timer1_after_reset(b);
    usart_after_reset(b);
    adc_after_reset(b);
}

/* simavr writes to standard output as it loads, where our answers go. */
static int load_quietly(const char *elf, elf_firmware_t *program)
{
    fflush(stdout);
    int kept = dup(STDOUT_FILENO), nothing = open("/dev/null", O_WRONLY);
    dup2(nothing, STDOUT_FILENO);
    int result = elf_read_firmware(elf, program);
    fflush(stdout);
    dup2(kept, STDOUT_FILENO);
    close(kept);
    close(nothing);
    return result;
}

/* True for an ELF file with code for the AVR, about which simavr would talk at length. */
static bool is_program(const char *path)
{
    uint8_t start[20] = {0};
    FILE *file = fopen(path, "rb");
    size_t count = file ? fread(start, 1, sizeof start, file) : 0;
    if (file)
        fclose(file);
    return count == sizeof start && memcmp(start, "\177ELF\1", 5) == 0 && start[18] == 83;
}

board *board_new(timeline *line, const char *name, const char *elf, double frequency, double ppm,
                 double start, const char **problem)
{
    if (line->boards_count == BOARDS_MAX) {
        *problem = "there are too many boards";
        return NULL;
    }
    elf_firmware_t program = {0};
    if (access(elf, R_OK) != 0) {
        *problem = "cannot read the program";
        return NULL;
    }
    if (!is_program(elf) || load_quietly(elf, &program) != 0 || !program.flash ||
        program.flashsize == 0) {
        *problem = "the program is not an ELF file for the AVR";
        return NULL;
    }
    avr_t *avr = avr_make_mcu_by_name("atmega644");
    if (!avr || program.flashsize > avr->flashend + 1u) {
        *problem = avr ? "the program does not fit into an ATmega644"
                       : "this simavr has no ATmega644";
        return NULL;
    }
    board *b = memory_new(sizeof *b);
    b->line = line;
    b->index = line->boards_count;
    snprintf(b->name, sizeof b->name, "%s", name);
    b->avr = avr;
    avr_init(avr);
    avr_load_firmware(avr, &program);
    free(program.flash);
    avr->frequency = (uint32_t)lround(frequency);
    b->run = avr->run;
    b->data_end = (uint16_t)(RAM_START + program.datasize + program.bsssize);
    b->stack_low = avr->ramend;
    b->origin_cycle = avr->cycle;
    b->held_until = start;
    board_tune(b, frequency, ppm);

    flags_install(b);
    pins_install(b);
    extint_install(b);
    capture_install(b);
    timer1_install(b);
    usart_install(b);
    adc_install(b);
    mend_after_reset(b, MCUSR_POWER_ON);
    line->boards[line->boards_count++] = b;
    return b;
}

void board_free(board *b)
{
    if (!b)
        return;
    avr_terminate(b->avr);
    free(b->avr);
    free(b);
}

void board_tune(board *b, double nominal, double ppm)
{
    b->origin = b->frequency > 0 ? board_time_of(b, (double)b->avr->cycle) : b->line->now;
    b->origin_cycle = b->avr->cycle;
    b->frequency = nominal * (1.0 + ppm * 1e-6);
    b->period = 1.0 / b->frequency;
    keep_time(b);
}

static void restart(board *b, uint8_t cause)
{
    b->resets++;
    avr_reset(b->avr);
    mend_after_reset(b, cause);
    report_begin(&b->line->report, b->now, "reset");
    report_text(&b->line->report, "board", b->name);
    report_flag(&b->line->report, "watchdog", cause == MCUSR_WATCHDOG);
    report_end(&b->line->report);
}

void board_reset(board *b, double hold)
{
    b->held_until = b->line->now + hold;
    restart(b, MCUSR_EXTERNAL);
}

bool board_asleep(const board *b)
{
    return b->avr->state == cpu_Sleeping || b->held_until > b->now;
}

double board_next_action(const board *b)
{
    if (b->held_until > b->now)
        return b->held_until;
    if (b->avr->state != cpu_Sleeping)
        return b->now;
    avr_cycle_timer_slot_p next = b->avr->cycle_timers.timer;
    return next ? later_of(b->now, board_time_of(b, (double)next->when)) : INFINITY;
}

/* Lets time pass up to `limit` without executing anything; at least one cycle. */
static void pass(board *b, double limit, avr_cycle_count_t longest)
{
    double cycles = ceil(board_cycle_of(b, limit) - (double)b->avr->cycle);
    avr_cycle_count_t skipped = cycles > 1.0 ? (avr_cycle_count_t)earlier_of(cycles, 1e9) : 1;
    if (skipped > longest)
        skipped = longest > 1 ? longest : 1;
    b->avr->cycle += skipped;
    b->asleep += skipped;
}

static void look_at_stack(board *b)
{
    uint16_t pointer = (uint16_t)(b->avr->data[REG_SPL] | b->avr->data[REG_SPH] << 8);
    if (pointer < b->stack_low && pointer >= RAM_START)
        b->stack_low = pointer;
}

static void sleep_on(board *b, double limit, avr_cycle_count_t until_timer)
{
    if (b->avr->data[REG_SMCR] & SMCR_MODE && !b->slept_deep) {
        /* In simavr all clocks run on in every sleep mode; in the part only in idle. */
        b->slept_deep = true;
        report_warning(&b->line->report, b->now, b->name,
                       "sleeps deeper than idle, where timer 1 and the USART stand still");
    }
    pass(b, limit, until_timer);
}

bool board_step(board *b, double limit)
{
    avr_t *avr = b->avr;
    if (b->held_until > b->now) {
        pass(b, earlier_of(limit, b->held_until), UINT32_MAX);
        keep_time(b);
        return true;
    }
    if (b->usart.level)
        usart_raise_levels(b);
    if (b->extint.level)
        extint_raise_levels(b);
    avr_flashaddr_t next = avr->pc;
    if (avr->state == cpu_Running) {
        next = avr_run_one(avr);
        look_at_stack(b);
    }
    avr_cycle_count_t until_timer = avr_cycle_timer_process(avr);
    avr->pc = next;
    if (avr->run != b->run) {
        keep_time(b);
        restart(b, MCUSR_WATCHDOG);
        return true;
    }
    if (avr->state == cpu_Sleeping) {
        if (!avr->sreg[S_I]) {
            report_warning(&b->line->report, b->now, b->name,
                           "sleeps with interrupts off for good");
            avr->state = cpu_Done;
        } else {
            sleep_on(b, limit, until_timer);
        }
    }
    if (avr->interrupt_state && (avr->state == cpu_Running || avr->state == cpu_Sleeping)) {
        avr_flashaddr_t before = avr->pc;
        avr_service_interrupts(avr);
        if (avr->pc != before)
            avr->cycle += INTERRUPT_ENTRY; /* none in simavr */
    }
    keep_time(b);
    if (avr->state == cpu_Done || avr->state == cpu_Crashed) {
        report_begin(&b->line->report, b->now, "crash");
        report_text(&b->line->report, "board", b->name);
        report_count(&b->line->report, "pc", avr->pc);
        report_end(&b->line->report);
        return false;
    }
    return true;
}

avr_int_vector_t *board_vector(const board *b, uint8_t number)
{
    const avr_int_table_t *table = &b->avr->interrupts;
    for (int i = 0; i < table->vector_count; i++)
        if (table->vector[i]->vector == number)
            return table->vector[i];
    return NULL;
}

void board_unmask(board *b, avr_int_vector_t *vector)
{
    if (avr_regbit_get(b->avr, vector->enable) && avr_regbit_get(b->avr, vector->raised) &&
        !vector->pending)
        avr_raise_interrupt(b->avr, vector);
}

write_handler board_on_write(board *b, uint16_t address, avr_io_write_t call, void *param)
{
    /* Not by avr_register_io_write: that would call the old handler as well. */
    avr_t *avr = b->avr;
    avr_io_addr_t io = AVR_DATA_TO_IO(address);
    write_handler old = {avr->io[io].w.c, avr->io[io].w.param};
    avr->io[io].w.c = call;
    avr->io[io].w.param = param;
    return old;
}

void board_on_read(board *b, uint16_t address, avr_io_read_t call, void *param)
{
    avr_io_addr_t io = AVR_DATA_TO_IO(address);
    b->avr->io[io].r.c = call;
    b->avr->io[io].r.param = param;
}
