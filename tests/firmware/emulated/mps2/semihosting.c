#include "emulated/mps2/semihosting.h"

enum { SYS_OPEN = 0x01, SYS_WRITE = 0x05, SYS_READ = 0x06, SYS_EXIT = 0x18, MODE_READ = 1, MODE_WRITE = 5 };
enum { APPLICATION_EXIT = 0x20026 };

static uint32_t host(uint32_t call, const void *arguments)
{
    register uint32_t r0 __asm("r0") = call;
    register const void *r1 __asm("r1") = arguments;
    __asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

int tact_host_open(const char *name, int writes)
{
    uint32_t length = 0;
    while (name[length] != 0)
        length++;
    const uint32_t arguments[3] = {(uint32_t)(uintptr_t)name, writes ? MODE_WRITE : MODE_READ, length};
    return (int)host(SYS_OPEN, arguments);
}

size_t tact_host_read(int handle, uint8_t *bytes, size_t most)
{
    const uint32_t arguments[3] = {(uint32_t)handle, (uint32_t)(uintptr_t)bytes, most};
    const uint32_t missing = host(SYS_READ, arguments);
    return missing > most ? 0 : most - missing;
}

void tact_host_write(int handle, const uint8_t *bytes, size_t size)
{
    while (size != 0) {
        const uint32_t arguments[3] = {(uint32_t)handle, (uint32_t)(uintptr_t)bytes, size};
        const uint32_t missing = host(SYS_WRITE, arguments);
        if (missing >= size)
            return; /* nobody is there any more */
        bytes += size - missing;
        size = missing;
    }
}

void tact_host_exit(void)
{
    (void)host(SYS_EXIT, (const void *)(uintptr_t)APPLICATION_EXIT);
}
