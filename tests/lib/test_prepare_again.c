/* SPDX-License-Identifier: MIT */
/* A plan that is prepared again with equal parameters while another context reads it (Linux). A child prepares it one machine
 * instruction at a time (ptrace). After each instruction the plan must have the same bits. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <unistd.h>

#include "dahl_compensator.h"
#include "models.h"
#include "plans.h"

typedef dahl_err_t (*prepare_t)(any_plan_t *plan, const set_t *set);

static const dahl_params_t many[] = {
    {100.0f, 0.5f, 3.8349519e-4f}, {100.0f, 0.5f, 0.0f}, {1e-3f, 1e-3f, 9.4e-10f}, {0x1.fffffep+10f, 1.0f, 500.0f}, {33.0f, 2.0f, 1e-3f},
};
#define MANY (sizeof many / sizeof many[0])

static dahl_err_t velocity(any_plan_t *plan, const set_t *set)
{
    const dahl_velocity_params_t table = {3, {set->p.Fc, -set->p.sigma0, 0.0f, set->p.sigma0}};
    return dahl_velocity_prepare((dahl_velocity_plan_t *)(void *)plan, &table);
}

enum { PLANS = MODELS + 1 }; /* the models, then the table over speed */

static prepare_t prepare_of(size_t i)
{
    return i < MODELS ? models[i].prepare : velocity;
}

static float more_of(size_t i)
{
    return i < MODELS ? more_for(&models[i], 1, 0.98f, 0.6f) : 0;
}

static void child(prepare_t prepare, any_plan_t *plan, const set_t *params)
{
    if (ptrace(PTRACE_TRACEME, 0, NULL, NULL) != 0) {
        _exit(2);
    }
    raise(SIGSTOP);
    _exit(prepare(plan, params) == DAHL_OK ? 0 : 1);
}

/* Prepare twice; return the instructions of the second time after which the plan differs, and count all. */
static unsigned count_changes(prepare_t prepare, const set_t *set, long *instructions)
{
    const int zeros = open("/dev/zero", O_RDWR);
    any_plan_t *shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED, zeros, 0), before;
    TEST_ASSERT_TRUE(shared != MAP_FAILED && close(zeros) == 0);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, prepare(shared, set));
    memcpy(&before, shared, sizeof before);
    unsigned changes = 0;
    int status = 0;
    pid_t pid = fork();
    if (pid == 0) {
        child(prepare, shared, set);
    }
    for (waitpid(pid, &status, 0); WIFSTOPPED(status); waitpid(pid, &status, 0)) {
        changes += memcmp(&before, shared, sizeof before) != 0;
        ++*instructions;
        ptrace(PTRACE_SINGLESTEP, pid, NULL, NULL);
    }
    TEST_ASSERT_TRUE(WIFEXITED(status));
    if (WEXITSTATUS(status) == 2) {
        TEST_IGNORE_MESSAGE("ptrace is not allowed here");
    }
    TEST_ASSERT_EQUAL_INT(0, WEXITSTATUS(status));
    munmap(shared, sizeof *shared);
    return changes;
}

static void test_equal_parameters_change_nothing_at_any_moment(void)
{
    for (size_t i = 0; i < MANY * PLANS; i++) {
        const prepare_t prepare = prepare_of(i / MANY);
        const set_t set = {many[i % MANY], more_of(i / MANY)};
        long instructions = 0;
        if (prepare == dahl_model_prepare || set.p.theta_per_count != 0) {
            TEST_ASSERT_EQUAL_UINT(0, count_changes(prepare, &set, &instructions));
            TEST_ASSERT_TRUE(instructions > 1000);
        }
    }
}

/* A stored plan is compared with a fresh one of zeros (dahl.h, Plans). */
static void test_equal_parameters_give_equal_bytes(void)
{
    const dahl_compensator_params_t compensation = {
        .friction = many[0], .law = DAHL_COMPENSATOR_REFERENCE, .gain = 0.9f, .limit = 1.0f, .slew = 50.0f, .period = 1e-3f,
        .play = 1, .jump = 200};
    dahl_compensator_plan_t stored_compensator = {0}, fresh_compensator = {0};
    for (size_t i = 0; i < PLANS; i++) {
        const set_t set = {many[0], more_of(i)};
        any_plan_t stored, fresh;
        memset(&stored, 0, sizeof stored);
        memset(&fresh, 0, sizeof fresh);
        TEST_ASSERT_EQUAL_INT(DAHL_OK, prepare_of(i)(&stored, &set) | prepare_of(i)(&fresh, &set));
        TEST_ASSERT_EQUAL_MEMORY(&stored, &fresh, sizeof stored);
    }
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&stored_compensator, &compensation));
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&fresh_compensator, &compensation));
    TEST_ASSERT_EQUAL_MEMORY(&stored_compensator, &fresh_compensator, sizeof stored_compensator);
}
