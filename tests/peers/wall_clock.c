/* A clock of the day that a test sets, for one process (LD_PRELOAD): $WALL_CLOCK is a file with the
 * nanoseconds by which it is ahead, as eight bytes.
 *
 * As the kernel does it: the monotonic clocks go on, and who waits until a time of the day waits
 * longer where the clock is set back meanwhile. So those waits look at the clock again and again.
 * libfaketime leaves out cnd_timedwait, by which librdkafka waits.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <threads.h>
#include <time.h>
#include <unistd.h>

#define SECOND INT64_C(1000000000)
#define LOOK (SECOND / 50)

static volatile int64_t *ahead;

__attribute__((constructor)) static void begin(void) {
    const char *path = getenv("WALL_CLOCK");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (file < 0)
        return;
    void *page = mmap(NULL, sizeof *ahead, PROT_READ, MAP_SHARED, file, 0);
    close(file);
    ahead = page == MAP_FAILED ? NULL : page;
}

static int64_t ns_of(const struct timespec *at) { return at->tv_sec * SECOND + at->tv_nsec; }

static struct timespec at_ns(int64_t ns) {
    return (struct timespec){.tv_sec = ns / SECOND, .tv_nsec = ns % SECOND};
}

static int64_t true_ns(void) {
    struct timespec now;
    syscall(SYS_clock_gettime, CLOCK_REALTIME, &now);
    return ns_of(&now);
}

static int64_t shown_ns(void) { return true_ns() + (ahead ? *ahead : 0); }

int clock_gettime(clockid_t clock, struct timespec *now) {
    if (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE) {
        *now = at_ns(shown_ns());
        return 0;
    }
    return syscall(SYS_clock_gettime, clock, now);
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    (void)zone;
    int64_t ns = shown_ns();
    *now = (struct timeval){.tv_sec = ns / SECOND, .tv_usec = ns % SECOND / 1000};
    return 0;
}

time_t time(time_t *where) {
    time_t now = shown_ns() / SECOND;
    if (where)
        *where = now;
    return now;
}

int timespec_get(struct timespec *now, int base) {
    *now = at_ns(shown_ns());
    return base;
}

/* A condition that was made with another clock than that of the day. */
static int is_monotonic(pthread_cond_t *condition) {
    return condition->__data.__wrefs >> 1 & 1; /* glibc: nptl/pthreadP.h */
}

static int wait_until(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *end) {
    static int (*real)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
    if (!real) /* x86-64 has an older one, too */
        real = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
    if (!real)
        real = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
    if (is_monotonic(condition))
        return real(condition, mutex, end);
    for (;;) {
        int64_t left = ns_of(end) - shown_ns();
        struct timespec look = at_ns(true_ns() + (left < LOOK ? left : LOOK));
        int result = real(condition, mutex, &look);
        if (result != ETIMEDOUT || left <= LOOK)
            return result;
    }
}

int pthread_cond_timedwait(pthread_cond_t *restrict condition, pthread_mutex_t *restrict mutex,
                           const struct timespec *restrict end) {
    return wait_until(condition, mutex, end);
}

int cnd_timedwait(cnd_t *restrict condition, mtx_t *restrict mutex,
                  const struct timespec *restrict end) {
    int result = wait_until((pthread_cond_t *)condition, (pthread_mutex_t *)mutex, end);
    return result == 0 ? thrd_success : result == ETIMEDOUT ? thrd_timedout : thrd_error;
}
