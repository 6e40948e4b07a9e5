/* Start of a Cortex-M7 in QEMU: stack, the floating-point unit, newlib's start. */
#include <stdint.h>
extern void _start(void);
extern uint32_t __stack;
static void begin(void)
{
    *(volatile uint32_t *)0xE000ED88U |= 0xFU << 20; /* CPACR: full access to the FPU */
    __asm volatile("dsb\n isb");
    _start();
    for (;;) {
    }
}
__attribute__((section(".vectors"), used)) const void *const vectors[] = {&__stack, (const void *)begin};

/* What newlib calls around main, and is in crti.o elsewhere. */
void _init(void);
void _fini(void);
void _init(void) {}
void _fini(void) {}
