/* What a power loss leaves: a copy of each file of a directory, as of its last completed fsync.

   LD_PRELOAD this with SYNCED_FROM (a directory) and SYNCED_TO (another one). After every fsync or fdatasync of a file
   in the first, its content is copied into the second, under a temporary name that is then renamed; so a process that
   is killed in between leaves the content of the sync before. A file that is unlinked is unlinked there too. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static pthread_mutex_t guard = PTHREAD_MUTEX_INITIALIZER;

static const char *name_in(const char *path) {
    const char *from = getenv("SYNCED_FROM");
    size_t length = from ? strlen(from) : 0;
    if (!length || strncmp(path, from, length) || path[length] != '/') return NULL;
    return strchr(path + length + 1, '/') ? NULL : path + length + 1;
}

static void copy(int fd) {
    char link[64], path[PATH_MAX], target[PATH_MAX], half[PATH_MAX + 8], buffer[1 << 16];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return;
    path[length] = 0;
    const char *name = name_in(path);
    if (!name) return;
    snprintf(target, sizeof target, "%s/%s", getenv("SYNCED_TO"), name);
    snprintf(half, sizeof half, "%s.half", target);
    int from = open(path, O_RDONLY), to = open(half, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    ssize_t some;
    while (from >= 0 && to >= 0 && (some = read(from, buffer, sizeof buffer)) > 0)
        if (write(to, buffer, some) != some) break;
    close(from);
    close(to);
    rename(half, target);
}

static int synced(const char *call, int fd) {
    int (*real)(int) = (int (*)(int))dlsym(RTLD_NEXT, call);
    pthread_mutex_lock(&guard);
    int result = real(fd);
    if (!result) copy(fd);
    pthread_mutex_unlock(&guard);
    return result;
}

int fsync(int fd) { return synced("fsync", fd); }
int fdatasync(int fd) { return synced("fdatasync", fd); }

int unlink(const char *path) {
    int (*real)(const char *) = (int (*)(const char *))dlsym(RTLD_NEXT, "unlink");
    const char *name = name_in(path);
    char target[PATH_MAX];
    if (name) {
        snprintf(target, sizeof target, "%s/%s", getenv("SYNCED_TO"), name);
        real(target);
    }
    return real(path);
}
