/* SPDX-License-Identifier: MIT */
/*
 * A plugin for QEMU's code generator that counts instructions of single calls. The image makes each call that is to be
 * counted from one place (target/call_*.S): counted is what runs after the instruction at `site` until the one at `back`.
 * At `mark` a new case begins. Written to `out`: a line `-` for each case, then the count of each of its calls.
 *
 *   qemu-system-arm ... -plugin libbench_plugin.so,site=0x1234,back=0x1236,mark=0x1240,out=counts.txt
 *
 * The few functions of QEMU's plugin interface (version 1) are declared here, because Debian ships no header for them.
 * The machine has one processor and takes no interrupts while it is counted.
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
typedef void (*exit_callback_t)(qemu_plugin_id_t id, void *user);

void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id, tb_callback_t callback);
void qemu_plugin_register_vcpu_insn_exec_cb(struct qemu_plugin_insn *, exec_callback_t, int flags, void *user);
void qemu_plugin_register_atexit_cb(qemu_plugin_id_t id, exit_callback_t callback, void *user);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *block);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *block, size_t index);
uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *insn);

extern int qemu_plugin_version;
int qemu_plugin_version = 1;
int qemu_plugin_install(qemu_plugin_id_t id, const void *info, int argc, char **argv);

static struct {
    uint64_t site, back, mark;
    FILE *out;
    uint64_t count;
    bool counting;
} bench;

static void on_instruction(unsigned cpu, void *user)
{
    (void)cpu, (void)user;
    bench.count += bench.counting;
}

static void on_site(unsigned cpu, void *user)
{
    (void)cpu, (void)user;
    bench.count = 0;
    bench.counting = true;
}

static void on_back(unsigned cpu, void *user)
{
    (void)cpu, (void)user;
    if (bench.counting) {
        fprintf(bench.out, "%" PRIu64 "\n", bench.count);
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
        qemu_plugin_register_vcpu_insn_exec_cb(insn, callback_for(qemu_plugin_insn_vaddr(insn)), 0, NULL);
    }
}

static void at_end(qemu_plugin_id_t id, void *user)
{
    (void)id, (void)user;
    fclose(bench.out);
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
    if (bench.out == NULL || bench.site == 0 || bench.back == 0) {
        fputs("error: bench plugin needs site=, back=, mark= and out=\n", stderr);
        return -1;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, on_block);
    qemu_plugin_register_atexit_cb(id, at_end, NULL);
    return 0;
}
