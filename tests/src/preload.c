/* See preload.rs. System calls are made directly, so that nothing here depends on what it replaces. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static atomic_long calls;

/* `to` is the new name of what is renamed, and null for an fsync. */
static void count(const char *to) {
    const char *into = getenv("ELO_TEST_DIE_INTO");
    if (into && !(to && strstr(to, into))) return;
    const char *die = getenv("ELO_TEST_DIE_AT"), *stop = getenv("ELO_TEST_STOP_AT");
    long call = atomic_fetch_add(&calls, 1) + 1;
    if (die && call == atol(die)) {
        syscall(SYS_kill, getpid(), SIGKILL);
        for (;;) pause();
    }
    if (stop && call == atol(stop)) syscall(SYS_kill, getpid(), SIGSTOP);
}

int fsync(int file) {
    count(NULL);
    return (int)syscall(SYS_fsync, file);
}

int rename(const char *from, const char *to) {
    count(to);
    return (int)syscall(SYS_renameat2, AT_FDCWD, from, AT_FDCWD, to, 0);
}

static atomic_long looks;

static long jump(void) {
    static const long days[] = {1, -1, 0, 2, -3};
    return getenv("ELO_TEST_CLOCK") ? 86400 * days[atomic_fetch_add(&looks, 1) % 5] : 0;
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    int result = (int)syscall(SYS_clock_gettime, clock, now);
    if (result == 0 && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE || clock == CLOCK_TAI))
        now->tv_sec += jump();
    return result;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    int result = (int)syscall(SYS_gettimeofday, now, zone);
    if (result == 0) now->tv_sec += jump();
    return result;
}

time_t time(time_t *result) {
    struct timespec now = {0, 0};
    clock_gettime(CLOCK_REALTIME, &now);
    if (result) *result = now.tv_sec;
    return now.tv_sec;
}
