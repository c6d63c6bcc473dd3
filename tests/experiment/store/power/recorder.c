/* Loaded before the C library: writes down what a program asks of the files in one folder, in the order in which it
   asks: bytes written, lengths cut, names removed, and what was brought to the disk. Nothing is changed or kept back. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int out = -1;

static void put(const void *bytes, size_t count) {
    const char *at = bytes;
    while (count > 0) {
        long done = syscall(SYS_write, out, at, count);
        if (done <= 0) abort();
        at += done;
        count -= (size_t)done;
    }
}

/* One record: kind, length of the path, place in the file, number of bytes; then the path and the bytes. */
static void note(char kind, const char *path, int64_t place, const void *bytes, uint32_t count) {
    const char *folder = getenv("RECORDED_FOLDER"), *log = getenv("RECORDED_LOG");
    if (!folder || !log || strncmp(path, folder, strlen(folder)) != 0 || strstr(path, "-shm")) return;
    pthread_mutex_lock(&lock);
    if (out < 0) out = (int)syscall(SYS_openat, AT_FDCWD, log, O_WRONLY | O_CREAT | O_APPEND, 0600);
    if (out < 0) abort();
    uint16_t length = (uint16_t)strlen(path);
    put(&kind, 1);
    put(&length, sizeof length);
    put(&place, sizeof place);
    put(&count, sizeof count);
    put(path, length);
    put(bytes, count);
    pthread_mutex_unlock(&lock);
}

static const char *path_of(int fd, char *into) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t count = readlink(link, into, PATH_MAX - 1);
    into[count > 0 ? count : 0] = 0;
    return into;
}

ssize_t pwrite(int fd, const void *bytes, size_t count, off_t place) {
    char path[PATH_MAX];
    ssize_t done = syscall(SYS_pwrite64, fd, bytes, count, place);
    if (done > 0) note('w', path_of(fd, path), place, bytes, (uint32_t)done);
    return done;
}

ssize_t pwrite64(int fd, const void *bytes, size_t count, off64_t place) { return pwrite(fd, bytes, count, place); }

ssize_t write(int fd, const void *bytes, size_t count) {
    char path[PATH_MAX];
    ssize_t done = syscall(SYS_write, fd, bytes, count);
    if (done > 0) note('w', path_of(fd, path), lseek(fd, 0, SEEK_CUR) - done, bytes, (uint32_t)done);
    return done;
}

int ftruncate(int fd, off_t length) {
    char path[PATH_MAX];
    int failed = (int)syscall(SYS_ftruncate, fd, length);
    if (!failed) note('t', path_of(fd, path), length, "", 0);
    return failed;
}

int ftruncate64(int fd, off64_t length) { return ftruncate(fd, length); }

static int sync_of(long number, int fd) {
    char path[PATH_MAX];
    int failed = (int)syscall(number, fd);
    if (!failed) note('s', path_of(fd, path), 0, "", 0);
    return failed;
}

int fsync(int fd) { return sync_of(SYS_fsync, fd); }

int fdatasync(int fd) { return sync_of(SYS_fdatasync, fd); }

int unlink(const char *path) {
    char whole[PATH_MAX];
    int failed = (int)syscall(SYS_unlinkat, AT_FDCWD, path, 0);
    if (!failed) note('u', path[0] == '/' ? path : strcat(strcat(getcwd(whole, PATH_MAX / 2), "/"), path), 0, "", 0);
    return failed;
}
