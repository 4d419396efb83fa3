/* SPDX-License-Identifier: MIT */
/*
 * A plugin for QEMU's code generator that counts instructions, cycles and bytes of stack of single calls. The image makes all
 * counted calls from one place (target/call_*.S). The plugin counts from the instruction after `site` up to the one at `back`.
 * At `mark` a new case begins. `out` receives a line `-` for each case, then a line for each of its calls: instructions, least
 * and most cycles, stack, address of the function modulo 2 MiB. The stack is the distance from the stack pointer at `site` to
 * the lowest address above `floor` that the call reads or writes. The instruction before `site` must store a word at the stack
 * pointer.
 * `costs` is a file with the cost of each instruction (cycles.py); without it all cycles are 0.
 *
 *   qemu-system-arm ... -plugin plugin.so,site=0x1234,back=0x1236,mark=0x1240,floor=0x20000800,costs=costs.txt,out=counts.txt
 *
 * The few functions of QEMU's plugin interface (version 1) are declared here, because Debian has no header for them.
 * The machine has one processor and handles no interrupts during a count.
 */
#include <inttypes.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef uint64_t qemu_plugin_id_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
typedef void (*tb_callback_t)(qemu_plugin_id_t id, struct qemu_plugin_tb *block);
typedef void (*exec_callback_t)(unsigned cpu, void *user);
typedef void (*memory_callback_t)(unsigned cpu, uint32_t info, uint64_t address, void *user);
typedef void (*exit_callback_t)(qemu_plugin_id_t id, void *user);

void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id, tb_callback_t callback);
void qemu_plugin_register_vcpu_insn_exec_cb(struct qemu_plugin_insn *, exec_callback_t, int flags, void *user);
void qemu_plugin_register_vcpu_mem_cb(struct qemu_plugin_insn *, memory_callback_t, int flags, int access, void *user);
void qemu_plugin_register_atexit_cb(qemu_plugin_id_t id, exit_callback_t callback, void *user);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *block);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *block, size_t index);
uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *insn);

extern int qemu_plugin_version;
int qemu_plugin_version = 1;
int qemu_plugin_install(qemu_plugin_id_t id, const void *info, int argc, char **argv);

/* Cycles of an instruction: if the next one in memory follows, and if another one does. */
typedef struct {
    uint8_t halfwords;
    uint8_t least, most;
    uint8_t jump_least, jump_most;
} cost_t;

#define READS_AND_WRITES 3

#define CODE_HALFWORDS (1u << 20) /* the code of an image must lie in 2 MiB */

static cost_t costs[CODE_HALFWORDS];

static struct {
    uint64_t site, back, mark, floor;
    FILE *out;
    uint64_t count, least, most;
    uint64_t stack_pointer, lowest; /* at the call; of the stack since then */
    const cost_t *first, *last;
    bool counting;
} bench;

static cost_t *cost_at(uint64_t address)
{
    return &costs[address / 2 % CODE_HALFWORDS];
}

/* Add the cost of the last instruction. Only its successor shows whether it jumped. */
static void add_last(const cost_t *next)
{
    const cost_t *last = bench.last;
    if (last != NULL) {
        bool is_jump = next != last + last->halfwords;
        bench.least += is_jump ? last->jump_least : last->least;
        bench.most += is_jump ? last->jump_most : last->most;
    }
    bench.last = next;
}

static void on_instruction(unsigned cpu, void *user)
{
    (void)cpu;
    if (bench.counting) {
        add_last(user);
        bench.first = bench.count == 0 ? user : bench.first;
        bench.count++;
    }
}

static void on_memory(unsigned cpu, uint32_t info, uint64_t address, void *user)
{
    (void)cpu, (void)info, (void)user;
    if (!bench.counting) {
        bench.stack_pointer = address;
    } else if (address >= bench.floor && address < bench.lowest) {
        bench.lowest = address;
    }
}

static void on_site(unsigned cpu, void *user)
{
    (void)cpu, (void)user;
    bench.count = bench.least = bench.most = 0;
    bench.lowest = bench.stack_pointer;
    bench.last = NULL;
    bench.counting = true;
}

static void on_back(unsigned cpu, void *user)
{
    (void)cpu;
    if (bench.counting) {
        add_last(user);
        fprintf(bench.out, "%" PRIu64 " %" PRIu64 " %" PRIu64 " %" PRIu64 " %td\n", bench.count, bench.least, bench.most,
                bench.stack_pointer - bench.lowest, 2 * (bench.first - costs));
    }
    bench.counting = false;
}

static void on_mark(unsigned cpu, void *user)
{
    (void)cpu, (void)user;
    fputs("-\n", bench.out);
}

static exec_callback_t callback_for(uint64_t address)
{
    if (address == bench.site) {
        return on_site;
    }
    if (address == bench.back) {
        return on_back;
    }
    return address == bench.mark ? on_mark : on_instruction;
}

static void on_block(qemu_plugin_id_t id, struct qemu_plugin_tb *block)
{
    (void)id;
    for (size_t i = 0; i < qemu_plugin_tb_n_insns(block); i++) {
        struct qemu_plugin_insn *insn = qemu_plugin_tb_get_insn(block, i);
        uint64_t address = qemu_plugin_insn_vaddr(insn);
        qemu_plugin_register_vcpu_insn_exec_cb(insn, callback_for(address), 0, cost_at(address));
        qemu_plugin_register_vcpu_mem_cb(insn, on_memory, 0, READS_AND_WRITES, NULL);
    }
}

static void at_end(qemu_plugin_id_t id, void *user)
{
    (void)id, (void)user;
    fclose(bench.out);
}

/* Read lines of address, bytes and four costs. */
static bool read_costs(const char *name)
{
    FILE *in = fopen(name, "r");
    uint64_t address;
    unsigned bytes, least, most, jump_least, jump_most;
    if (in == NULL) {
        return false;
    }
    while (fscanf(in, "%" SCNx64 " %u %u %u %u %u", &address, &bytes, &least, &most, &jump_least, &jump_most) == 6) {
        *cost_at(address) = (cost_t){(uint8_t)(bytes / 2), (uint8_t)least, (uint8_t)most, (uint8_t)jump_least,
                                     (uint8_t)jump_most};
    }
    return fclose(in) == 0;
}

static bool take_argument(const char *argument)
{
    const char *value = strchr(argument, '=');
    if (value == NULL) {
        return false;
    }
    switch (argument[0]) {
    case 's': bench.site = strtoull(value + 1, NULL, 0); return true;
    case 'b': bench.back = strtoull(value + 1, NULL, 0); return true;
    case 'm': bench.mark = strtoull(value + 1, NULL, 0); return true;
    case 'f': bench.floor = strtoull(value + 1, NULL, 0); return true;
    case 'c': return read_costs(value + 1);
    case 'o': bench.out = fopen(value + 1, "w"); return bench.out != NULL;
    default: return false;
    }
}

int qemu_plugin_install(qemu_plugin_id_t id, const void *info, int argc, char **argv)
{
    (void)info;
    for (int i = 0; i < argc; i++) {
        if (!take_argument(argv[i])) {
            fprintf(stderr, "error: bench plugin cannot use '%s'\n", argv[i]);
            return -1;
        }
    }
    if (bench.out == NULL || bench.site == 0 || bench.back == 0 || bench.floor == 0) {
        fputs("error: bench plugin needs site=, back=, mark=, floor= and out=\n", stderr);
        return -1;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, on_block);
    qemu_plugin_register_atexit_cb(id, at_end, NULL);
    return 0;
}
