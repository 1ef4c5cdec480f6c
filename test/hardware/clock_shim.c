/* Sets the system clock of the processes that it is preloaded into, for tests.
 *
 * CLOCK_REALTIME is the kernel's plus the offset [ns] in the file named by CLOCK_SHIM_OFFSET, an
 * int64 that is mapped into memory, so that a test sets the clock of several processes at once.
 *
 * Waits with a deadline in system time get it in the kernel's time. Without that each wait of the
 * middleware and its C++ library would be longer by the offset, which no set clock does.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define BILLION 1000000000LL
/* Deadlines of the monotonic clock lie below, those of the system clock above [s]. */
#define YEAR_2001 BILLION

static const volatile int64_t *offset;

__attribute__((constructor)) static void map_offset(void) {
    const char *path = getenv("CLOCK_SHIM_OFFSET");
    int fd = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *memory = MAP_FAILED;
    if (fd >= 0) {
        memory = mmap(NULL, sizeof *offset, PROT_READ, MAP_SHARED, fd, 0);
        close(fd);
    }
    if (memory != MAP_FAILED)
        offset = memory;
}

static struct timespec moved(struct timespec time, int64_t by) {
    int64_t sum = time.tv_sec * BILLION + time.tv_nsec + by;
    return (struct timespec){.tv_sec = sum / BILLION, .tv_nsec = sum % BILLION};
}

static int64_t now_offset(void) {
    return offset ? *offset : 0;
}

static struct timespec in_kernel_time(const struct timespec *deadline) {
    return deadline->tv_sec > YEAR_2001 ? moved(*deadline, -now_offset()) : *deadline;
}

static void *next(const char *symbol) {
    /* The oldest version of a condition's symbols has another layout. */
    void *found = dlvsym(RTLD_NEXT, symbol, "GLIBC_2.3.2");
    return found ? found : dlsym(RTLD_NEXT, symbol);
}

int clock_gettime(clockid_t clock, struct timespec *time) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real)
        real = (int (*)(clockid_t, struct timespec *))next("clock_gettime");
    int status = real(clock, time);
    if (!status && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
        *time = moved(*time, now_offset());
    return status;
}

int gettimeofday(struct timeval *restrict time, void *restrict zone) {
    struct timespec now;
    (void)zone;
    int status = clock_gettime(CLOCK_REALTIME, &now);
    *time = (struct timeval){.tv_sec = now.tv_sec, .tv_usec = now.tv_nsec / 1000};
    return status;
}

int pthread_cond_timedwait(pthread_cond_t *restrict condition, pthread_mutex_t *restrict mutex,
                           const struct timespec *restrict deadline) {
    static int (*real)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
    if (!real)
        real = (int (*)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *))next(
            "pthread_cond_timedwait");
    struct timespec moved_deadline = in_kernel_time(deadline);
    return real(condition, mutex, &moved_deadline);
}

int pthread_mutex_timedlock(pthread_mutex_t *restrict mutex,
                            const struct timespec *restrict deadline) {
    static int (*real)(pthread_mutex_t *, const struct timespec *);
    if (!real)
        real = (int (*)(pthread_mutex_t *, const struct timespec *))next(
            "pthread_mutex_timedlock");
    struct timespec moved_deadline = in_kernel_time(deadline);
    return real(mutex, &moved_deadline);
}

int sem_timedwait(sem_t *restrict semaphore, const struct timespec *restrict deadline) {
    static int (*real)(sem_t *, const struct timespec *);
    if (!real)
        real = (int (*)(sem_t *, const struct timespec *))next("sem_timedwait");
    struct timespec moved_deadline = in_kernel_time(deadline);
    return real(semaphore, &moved_deadline);
}
