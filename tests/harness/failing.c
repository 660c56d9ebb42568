/* I/O that fails: the k-th call on a file of a directory, or every one from the k-th on until told otherwise.

   LD_PRELOAD this with FAILING_IN (a directory). The process itself says what fails: `fail_from(k, 1)` lets the k-th
   call from now on fail, `fail_from(k, 0)` that one and all that follow, `fail_from(0, 0)` none; each returns how many
   calls have failed since it was last called with a number above 0. While `fail_pause(1)` holds, none fails or counts.
   Writes fail with ENOSPC, everything else with EIO. With FAILING_WRITES, an error number, writes alone fail, with it. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static pthread_mutex_t guard = PTHREAD_MUTEX_INITIALIZER;
static long calls, failed, from;
static int once, paused;

long fail_from(long call, int only_once) {
    pthread_mutex_lock(&guard);
    long before = failed;
    if (call) calls = failed = 0;
    from = call;
    once = only_once;
    pthread_mutex_unlock(&guard);
    return before;
}

void fail_pause(int now) { paused = now; }

static int is_watched(int fd) {
    if (paused) return 0;
    char link[64], path[PATH_MAX];
    const char *in = getenv("FAILING_IN");
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = in ? readlink(link, path, sizeof path - 1) : -1;
    return length > 0 && (path[length] = 0, !strncmp(path, in, strlen(in)));
}

static int fails(int fd, int error) {
    int before = errno;
    const char *writes = getenv("FAILING_WRITES");
    if (writes && error == ENOSPC) error = atoi(writes);
    else if (writes) return 0;
    if (!is_watched(fd)) {
        errno = before;
        return 0;
    }
    pthread_mutex_lock(&guard);
    long call = ++calls;
    int failing = from && (once ? call == from : call >= from);
    failed += failing;
    pthread_mutex_unlock(&guard);
    errno = failing ? error : before;
    return failing;
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

int fsync(int fd) { return fails(fd, EIO) ? -1 : REAL(fsync)(fd); }
int fdatasync(int fd) { return fails(fd, EIO) ? -1 : REAL(fdatasync)(fd); }
int ftruncate(int fd, off_t size) { return fails(fd, EIO) ? -1 : REAL(ftruncate)(fd, size); }
int ftruncate64(int fd, off64_t size) { return fails(fd, EIO) ? -1 : REAL(ftruncate64)(fd, size); }
ssize_t read(int fd, void *to, size_t size) { return fails(fd, EIO) ? -1 : REAL(read)(fd, to, size); }
ssize_t pread(int fd, void *to, size_t size, off_t at) { return fails(fd, EIO) ? -1 : REAL(pread)(fd, to, size, at); }
ssize_t pread64(int fd, void *to, size_t size, off64_t at) {
    return fails(fd, EIO) ? -1 : REAL(pread64)(fd, to, size, at);
}
ssize_t write(int fd, const void *what, size_t size) { return fails(fd, ENOSPC) ? -1 : REAL(write)(fd, what, size); }
ssize_t pwrite(int fd, const void *what, size_t size, off_t at) {
    return fails(fd, ENOSPC) ? -1 : REAL(pwrite)(fd, what, size, at);
}
ssize_t pwrite64(int fd, const void *what, size_t size, off64_t at) {
    return fails(fd, ENOSPC) ? -1 : REAL(pwrite64)(fd, what, size, at);
}
