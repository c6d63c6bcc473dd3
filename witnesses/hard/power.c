/* Writes down what a process does to the files of one folder, so that a power cut can be played: POWER_FOLDER names the folder,
 * POWER_LOG the journal. Each entry: kind, length of the path, offset, length of the content; then path and content. What was
 * not waited for (fsync, fdatasync) may be missing from the disk in any part. Preloaded below SQLite. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>

enum { WRITE = 1, TRUNCATE = 2, SYNC = 3, UNLINK = 4, LONGEST = 4096 };

struct entry {
    uint32_t kind, path_size;
    uint64_t offset, size;
};

static int journal_of(void)
{
    static int fd = -1;
    static pid_t opened_by;
    const char *name = getenv("POWER_LOG");
    if (!name || !*name)
        return -1;
    if (fd < 0 || opened_by != getpid()) {
        fd = (int)syscall(SYS_openat, AT_FDCWD, name, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
        opened_by = getpid();
    }
    return fd;
}

static void put(int fd, const void *bytes, size_t size)
{
    const char *at = bytes;
    while (size) {
        const long done = syscall(SYS_write, fd, at, size);
        if (done <= 0)
            abort();
        at += done, size -= (size_t)done;
    }
}

static void note_path(uint32_t kind, const char *path, uint64_t offset, const void *content, uint64_t size)
{
    const char *folder = getenv("POWER_FOLDER");
    const int fd = folder ? journal_of() : -1;
    if (fd < 0 || strncmp(path, folder, strlen(folder)) != 0)
        return;
    const struct entry entry = {kind, (uint32_t)strlen(path), offset, size};
    const size_t content_size = kind == WRITE ? (size_t)size : 0, whole = sizeof entry + entry.path_size + content_size;
    char *bytes = malloc(whole);
    if (!bytes)
        abort();
    memcpy(bytes, &entry, sizeof entry);
    memcpy(bytes + sizeof entry, path, entry.path_size);
    if (content_size)
        memcpy(bytes + sizeof entry + entry.path_size, content, content_size);
    put(fd, bytes, whole);
    free(bytes);
}

static void note(uint32_t kind, int of, uint64_t offset, const void *content, uint64_t size)
{
    char link[64], path[LONGEST];
    if (!getenv("POWER_LOG"))
        return;
    char digits[16];
    int at = 0, left = of;
    do
        digits[at++] = (char)('0' + left % 10);
    while (left /= 10);
    strcpy(link, "/proc/self/fd/");
    size_t end = strlen(link);
    while (at)
        link[end++] = digits[--at];
    link[end] = 0;
    const ssize_t length = readlink(link, path, sizeof path - 1);
    if (length <= 0)
        return;
    path[length] = 0;
    note_path(kind, path, offset, content, size);
}

#define REAL(type, name) ((type)dlsym(RTLD_NEXT, name))

ssize_t pwrite64(int fd, const void *content, size_t size, off64_t offset)
{
    note(WRITE, fd, (uint64_t)offset, content, size);
    return REAL(ssize_t(*)(int, const void *, size_t, off64_t), "pwrite64")(fd, content, size, offset);
}

ssize_t pwrite(int fd, const void *content, size_t size, off_t offset)
{
    return pwrite64(fd, content, size, offset);
}

ssize_t write(int fd, const void *content, size_t size)
{
    const off_t offset = getenv("POWER_LOG") ? lseek(fd, 0, SEEK_CUR) : -1;
    if (offset >= 0)
        note(WRITE, fd, (uint64_t)offset, content, size);
    return syscall(SYS_write, fd, content, size);
}

int ftruncate64(int fd, off64_t size)
{
    note(TRUNCATE, fd, 0, NULL, (uint64_t)size);
    return REAL(int (*)(int, off64_t), "ftruncate64")(fd, size);
}

int ftruncate(int fd, off_t size)
{
    return ftruncate64(fd, size);
}

int fsync(int fd)
{
    note(SYNC, fd, 0, NULL, 0);
    return 0;
}

int fdatasync(int fd)
{
    return fsync(fd);
}

int unlink(const char *path)
{
    const int done = REAL(int (*)(const char *), "unlink")(path);
    if (done == 0)
        note_path(UNLINK, path, 0, NULL, 0);
    return done;
}
