typedef union {
    cgl_real real;
    ${bits} bits;
} word;

static cgl_real real_of(${bits} bits)
{
    word w;
    w.bits = bits;
    return w.real;
}

static ${bits} bits_of(cgl_real x)
{
    word w;
    w.real = x;
    return w.bits;
}
