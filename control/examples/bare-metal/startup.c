/* Vector table and reset of a Cortex-M4F. The C library's start code does the rest. */
#include <stdint.h>

extern uint32_t stack_top;
extern void _start(void);
void reset(void);
static void stop(void);

typedef union {
    uint32_t *stack;
    void (*handler)(void);
} vector;

__attribute__((section(".vectors"), used)) static const vector vectors[16] = {
    {.stack = &stack_top}, {.handler = reset}, {.handler = stop}, {.handler = stop}, /* reset, NMI, hard fault */
    {.handler = stop},     {.handler = stop},  {.handler = stop}};

void reset(void)
{
    *(volatile uint32_t *)0xE000ED88U |= 0xFU << 20; /* CPACR: the FPU is on */
    __asm volatile("dsb\n\tisb");
    _start();
    stop();
}

static void stop(void)
{
    for (;;) {
    }
}
