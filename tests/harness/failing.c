/* I/O that fails: the k-th call on a file of a directory, every one from the k-th on, or each of some kinds.

   LD_PRELOAD this with FAILING_IN (a directory). The process itself says what fails: `fail_from(k, 1)` lets the k-th
   call from now on fail, `fail_from(k, 0)` that one and all that follow, `fail_from(0, 0)` none; each returns how many
   calls have failed since it was last called with a number above 0. While `fail_pause(1)` holds, none fails or counts.
   Writes fail with ENOSPC, everything else with EIO. With FAILING_WRITES, an error number, writes alone fail, with it.

   Another process says it in the file FAILING_BY, `struct order` below: which kinds of calls fail, with which error, on
   paths that end with a suffix (harness/failing.py). */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

static struct order {
    int error;        /* 0: nothing fails */
    char kinds[60];   /* of calls, each between two spaces */
    char suffix[56];  /* of the path; empty: any */
    long long failed; /* calls so far */
} none, *ordered = &none;

static pthread_mutex_t guard = PTHREAD_MUTEX_INITIALIZER;
static long calls, failed, from;
static int once, paused;

__attribute__((constructor)) static void begin(void) {
    const char *by = getenv("FAILING_BY");
    int fd = by ? REAL(open)(by, O_RDWR) : -1;
    void *shared = fd < 0 ? MAP_FAILED : REAL(mmap)(0, sizeof none, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (shared != MAP_FAILED) ordered = shared;
    if (fd >= 0) close(fd);
}

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

static int is_ordered(const char *kind, const char *path) {
    char wanted[16];
    size_t length = strlen(path), suffix = strlen(ordered->suffix);
    snprintf(wanted, sizeof wanted, " %s ", kind);
    int is = strstr(ordered->kinds, wanted) && suffix <= length && !strcmp(path + length - suffix, ordered->suffix);
    if (is) __sync_fetch_and_add(&ordered->failed, 1);
    return is;
}

/* The error with which a call on a path fails, or 0. */
static int failure(const char *kind, const char *path) {
    const char *in = getenv("FAILING_IN"), *writes = getenv("FAILING_WRITES");
    int is_write = !strcmp(kind, "write");
    if (paused || !in || strncmp(path, in, strlen(in))) return 0;
    if (ordered->error && is_ordered(kind, path)) return ordered->error;
    if (writes && !is_write) return 0;
    pthread_mutex_lock(&guard);
    long call = ++calls;
    int failing = from && (once ? call == from : call >= from);
    failed += failing;
    pthread_mutex_unlock(&guard);
    return !failing ? 0 : writes ? atoi(writes) : is_write ? ENOSPC : EIO;
}

static int fails_at(const char *kind, const char *path) {
    int before = errno, error = path ? failure(kind, path) : 0;
    errno = error ? error : before;
    return error;
}

static int fails(const char *kind, int fd) {
    int before = errno;
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = fd < 0 ? -1 : readlink(link, path, sizeof path - 1);
    errno = before;
    return length > 0 ? (path[length] = 0, fails_at(kind, path)) : 0;
}

/* Calls on a descriptor, and on a path: by kind. */
#define ON_FILE(kind, type, name, parameters, ...) \
    type name parameters { return fails(kind, fd) ? (type)-1 : REAL(name)(__VA_ARGS__); }
#define ON_PATH(kind, type, name, parameters, ...) \
    type name parameters { return fails_at(kind, path) ? (type)-1 : REAL(name)(__VA_ARGS__); }
#define OPENS(name, before, ...) \
    int name(before const char *path, int flags, ...) { \
        va_list rest; \
        va_start(rest, flags); \
        mode_t mode = (flags & O_CREAT) || (flags & O_TMPFILE) == O_TMPFILE ? va_arg(rest, mode_t) : 0; \
        va_end(rest); \
        return fails_at("open", path) ? -1 : REAL(name)(__VA_ARGS__, flags, mode); \
    }
#define DIRECTORY int at,

ON_FILE("sync", int, fsync, (int fd), fd)
ON_FILE("sync", int, fdatasync, (int fd), fd)
ON_FILE("truncate", int, ftruncate, (int fd, off_t size), fd, size)
ON_FILE("truncate", int, ftruncate64, (int fd, off64_t size), fd, size)
ON_FILE("read", ssize_t, read, (int fd, void *to, size_t size), fd, to, size)
ON_FILE("read", ssize_t, pread, (int fd, void *to, size_t size, off_t at), fd, to, size, at)
ON_FILE("read", ssize_t, pread64, (int fd, void *to, size_t size, off64_t at), fd, to, size, at)
ON_FILE("write", ssize_t, write, (int fd, const void *what, size_t size), fd, what, size)
ON_FILE("write", ssize_t, pwrite, (int fd, const void *what, size_t size, off_t at), fd, what, size, at)
ON_FILE("write", ssize_t, pwrite64, (int fd, const void *what, size_t size, off64_t at), fd, what, size, at)
ON_FILE("map", void *, mmap, (void *to, size_t size, int how, int flags, int fd, off_t at), to, size, how, flags, fd, at)
ON_FILE("map", void *, mmap64, (void *to, size_t size, int how, int flags, int fd, off64_t at), to, size, how, flags, fd,
        at)
ON_FILE("chmod", int, fchmod, (int fd, mode_t mode), fd, mode)
ON_FILE("stat", int, fstat, (int fd, struct stat *to), fd, to)
ON_FILE("stat", int, fstat64, (int fd, struct stat64 *to), fd, to)
ON_PATH("stat", int, stat, (const char *restrict path, struct stat *restrict to), path, to)
ON_PATH("stat", int, stat64, (const char *restrict path, struct stat64 *restrict to), path, to)
ON_PATH("stat", int, lstat, (const char *restrict path, struct stat *restrict to), path, to)
ON_PATH("stat", int, lstat64, (const char *restrict path, struct stat64 *restrict to), path, to)
ON_PATH("chmod", int, chmod, (const char *path, mode_t mode), path, mode)
ON_PATH("mkdir", int, mkdir, (const char *path, mode_t mode), path, mode)
ON_PATH("unlink", int, unlink, (const char *path), path)
ON_PATH("rename", int, rename, (const char *path, const char *to), path, to)
OPENS(open, , path)
OPENS(open64, , path)
OPENS(openat, DIRECTORY, at, path)
OPENS(openat64, DIRECTORY, at, path)
DIR *opendir(const char *path) { return fails_at("open", path) ? NULL : REAL(opendir)(path); }
int posix_fallocate(int fd, off_t at, off_t size) {
    int error = fails("fallocate", fd) ? errno : 0;
    return error ? error : REAL(posix_fallocate)(fd, at, size);
}
int posix_fallocate64(int fd, off64_t at, off64_t size) {
    int error = fails("fallocate", fd) ? errno : 0;
    return error ? error : REAL(posix_fallocate64)(fd, at, size);
}
