// Several numbers in one object, one for each lane, whose lanes are computed at once: the compiler's vector types, with the
// operations that the plant needs. A lane's result has the bits of the same computation with a double.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <type_traits>
#include <utility>

namespace cogless {

// The result of a comparison: bool for a double, a mask with one truth value for each lane of a Wide.
template <class Real>
struct MaskOfReal {
    using Type = typename Real::Mask;
};
template <>
struct MaskOfReal<double> {
    using Type = bool;
};
template <class Real>
using MaskOf = typename MaskOfReal<Real>::Type;

[[gnu::always_inline]] inline double select(bool condition, double yes, double no) { return condition ? yes : no; }

// width: numbers in a register of the processor. registers: registers of a Wide; two hide an operation's latency behind another.
// The alignment is stated, since the compiler's own depends on the instructions that it may use. Number: double, or float.
template <std::size_t width, std::size_t registers, class Number = double>
struct alignas(sizeof(Number) * width) Wide {
    typedef Number Register __attribute__((vector_size(sizeof(Number) * width)));
    using Integer = std::conditional_t<sizeof(Number) == 8, std::int64_t, std::int32_t>;
    typedef Integer Bits __attribute__((vector_size(sizeof(Number) * width)));
    static constexpr std::size_t lanes = width * registers;

    struct alignas(sizeof(Number) * width) Mask {
        Bits bits[registers];

        [[gnu::always_inline]] bool operator[](std::size_t lane) const { return bits[lane / width][lane % width] != 0; }
        [[gnu::always_inline]] void set(std::size_t lane, bool value) { bits[lane / width][lane % width] = value ? -1 : 0; }
        [[gnu::always_inline]] friend Mask operator&(const Mask& a, const Mask& b) {
            Mask both;
            for (std::size_t r = 0; r < registers; ++r) both.bits[r] = a.bits[r] & b.bits[r];
            return both;
        }
        [[gnu::always_inline]] friend Mask operator!(const Mask& a) {
            Mask none;
            for (std::size_t r = 0; r < registers; ++r) none.bits[r] = ~a.bits[r];
            return none;
        }
        [[gnu::always_inline]] bool any() const {
            Bits all = bits[0];
            for (std::size_t r = 1; r < registers; ++r) all |= bits[r];
            return packed(all) != 0;
        }
        // lane n as bit n
        [[gnu::always_inline]] std::uint32_t packed() const {
            std::uint32_t all = 0;
            for (std::size_t r = 0; r < registers; ++r) all |= packed(bits[r]) << (r * width);
            return all;
        }

    private:
        // The sign bits of a register, by one instruction where there is one.
        [[gnu::always_inline]] static std::uint32_t packed(const Bits& bits) {
#if defined(__AVX2__)
            typedef float Floats __attribute__((vector_size(32)));
            typedef double Doubles __attribute__((vector_size(32)));
            typedef std::int32_t Words __attribute__((vector_size(4 * width)));
            if constexpr (width == 8) {
                return static_cast<std::uint32_t>(
                    __builtin_ia32_movmskps256(reinterpret_cast<Floats>(__builtin_convertvector(bits, Words))));
            } else if constexpr (sizeof bits == 32) {
                return static_cast<std::uint32_t>(__builtin_ia32_movmskpd256(reinterpret_cast<Doubles>(bits)));
            }
#elif defined(__SSE2__)
            typedef float Floats __attribute__((vector_size(16)));
            typedef double Doubles __attribute__((vector_size(16)));
            if constexpr (width == 2) {
                return static_cast<std::uint32_t>(__builtin_ia32_movmskpd(reinterpret_cast<Doubles>(bits)));
            } else if constexpr (sizeof bits == 16) {
                return static_cast<std::uint32_t>(__builtin_ia32_movmskps(reinterpret_cast<Floats>(bits)));
            }
#endif
            std::uint32_t all = 0;
            for (std::size_t lane = 0; lane < width; ++lane) all |= bits[lane] != 0 ? 1U << lane : 0U;
            return all;
        }
    };

    Register part[registers];

    Wide() = default;
    [[gnu::always_inline]] Wide(Number all) {
        for (std::size_t r = 0; r < registers; ++r) part[r] = Register{} + all;
    }

    [[gnu::always_inline]] Number operator[](std::size_t lane) const { return part[lane / width][lane % width]; }
    [[gnu::always_inline]] void set(std::size_t lane, Number value) { part[lane / width][lane % width] = value; }

#define COGLESS_OPERATOR(op)                                                        \
    [[gnu::always_inline]] friend Wide operator op(const Wide& a, const Wide& b) {  \
        Wide c;                                                                     \
        for (std::size_t r = 0; r < registers; ++r) c.part[r] = a.part[r] op b.part[r]; \
        return c;                                                                   \
    }
    COGLESS_OPERATOR(+)
    COGLESS_OPERATOR(-)
    COGLESS_OPERATOR(*)
    COGLESS_OPERATOR(/)
#undef COGLESS_OPERATOR
    [[gnu::always_inline]] Wide operator-() const {
        Wide c;
        for (std::size_t r = 0; r < registers; ++r) c.part[r] = -part[r];
        return c;
    }
    [[gnu::always_inline]] Wide& operator+=(const Wide& b) { return *this = *this + b; }
    [[gnu::always_inline]] Wide& operator-=(const Wide& b) { return *this = *this - b; }

    [[gnu::always_inline]] friend Wide select(const Mask& condition, const Wide& yes, const Wide& no) {
        Wide c;
        for (std::size_t r = 0; r < registers; ++r) c.part[r] = condition.bits[r] ? yes.part[r] : no.part[r];
        return c;
    }
    [[gnu::always_inline]] friend Wide magnitude(const Wide& a) { return select(a > Wide(0), a, -a); }
#define COGLESS_COMPARISON(op)                                                          \
    [[gnu::always_inline]] friend Mask operator op(const Wide& a, const Wide& b) {      \
        Mask m;                                                                         \
        for (std::size_t r = 0; r < registers; ++r) m.bits[r] = a.part[r] op b.part[r]; \
        return m;                                                                       \
    }
    COGLESS_COMPARISON(>)
    COGLESS_COMPARISON(>=)
    COGLESS_COMPARISON(<)
    COGLESS_COMPARISON(<=)
#undef COGLESS_COMPARISON
};

// A type for each set of instructions, with enough registers to hide an operation's latency and few enough not to spill.
using Sse2 = Wide<2, 2>;
using Avx2 = Wide<4, 2>;
using Avx512 = Wide<8, 1>;

// Four numbers at once, on any processor.
using Four = Wide<2, 2>;

template <std::size_t count>
[[gnu::always_inline]] inline Four four_of(const std::array<double, count>& all) {
    static_assert(count == 3 || count == 4);
    Four x;
    x.part[0] = Four::Register{all[0], all[1]};
    x.part[1] = Four::Register{all[2], count == 4 ? all[count - 1] : 0.0};
    return x;
}

template <std::size_t count>
[[gnu::always_inline]] inline std::array<double, count> array_of(const Four& x) {
    std::array<double, count> all;
    for (std::size_t n = 0; n < count; ++n) all[n] = x[n];
    return all;
}

// Each number rounded towards zero; |x| is below 2^31.
template <std::size_t width, std::size_t registers>
[[gnu::always_inline]] inline Wide<width, registers> truncated(const Wide<width, registers>& x) {
    typedef std::int32_t Whole __attribute__((vector_size(4 * width)));
    Wide<width, registers> whole;
    for (std::size_t r = 0; r < registers; ++r) {
        whole.part[r] = __builtin_convertvector(__builtin_convertvector(x.part[r], Whole), typename Wide<width, registers>::Register);
    }
    return whole;
}

template <class Real>
constexpr bool is_wide = requires { Real::lanes; };

template <class Real>
constexpr std::size_t lanes_of = 1;
template <class Real>
    requires is_wide<Real>
constexpr std::size_t lanes_of<Real> = Real::lanes;

// Pointers to objects, one for each lane of a Real.
template <class Object, class Real>
using Each = std::array<const Object*, lanes_of<Real>>;

// A Real with one number of each lane's object.
template <class Real, class Object, std::size_t count, class Get>
Real each(const std::array<const Object*, count>& of, const Get& get) {
    Real all;
    for (std::size_t lane = 0; lane < count; ++lane) all.set(lane, std::invoke(get, *of[lane]));
    return all;
}

// Pointers to one member of each lane's object.
template <class Object, std::size_t count, class Member>
std::array<const Member*, count> members(const std::array<const Object*, count>& of, Member Object::*member) {
    std::array<const Member*, count> all;
    for (std::size_t lane = 0; lane < count; ++lane) all[lane] = &(of[lane]->*member);
    return all;
}

}  // namespace cogless
