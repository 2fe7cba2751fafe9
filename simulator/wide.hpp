// Several numbers in one object, one for each lane, whose lanes are computed at once: the compiler's vector types, with the
// operations that the plant needs. A lane's result has the bits of the same computation with a double.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>

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
// The alignment is stated, since the compiler's own depends on the instructions that it may use.
template <std::size_t width, std::size_t registers>
struct alignas(8 * width) Wide {
    typedef double Register __attribute__((vector_size(8 * width)));
    typedef std::int64_t Bits __attribute__((vector_size(8 * width)));
    static constexpr std::size_t lanes = width * registers;

    struct alignas(8 * width) Mask {
        Bits bits[registers];

        [[gnu::always_inline]] bool operator[](std::size_t lane) const { return bits[lane / width][lane % width] != 0; }
        [[gnu::always_inline]] void set(std::size_t lane, bool value) { bits[lane / width][lane % width] = value ? -1 : 0; }
        [[gnu::always_inline]] friend Mask operator&(const Mask& a, const Mask& b) {
            Mask both;
            for (std::size_t r = 0; r < registers; ++r) both.bits[r] = a.bits[r] & b.bits[r];
            return both;
        }
        [[gnu::always_inline]] bool any() const {
            Mask all = *this;
            for (std::size_t r = 1; r < registers; ++r) all.bits[0] |= bits[r];
            for (std::size_t lane = 0; lane < width; ++lane) {
                if (all[lane]) return true;
            }
            return false;
        }
        // lane n as bit n
        [[gnu::always_inline]] std::uint32_t packed() const {
            std::uint32_t all = 0;
            for (std::size_t lane = 0; lane < lanes; ++lane) all |= std::uint32_t{(*this)[lane]} << lane;
            return all;
        }
    };

    Register part[registers];

    Wide() = default;
    [[gnu::always_inline]] Wide(double all) {
        for (std::size_t r = 0; r < registers; ++r) part[r] = Register{} + all;
    }

    [[gnu::always_inline]] double operator[](std::size_t lane) const { return part[lane / width][lane % width]; }
    [[gnu::always_inline]] void set(std::size_t lane, double value) { part[lane / width][lane % width] = value; }

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

    [[gnu::always_inline]] friend Wide select(const Mask& condition, const Wide& yes, const Wide& no) {
        Wide c;
        for (std::size_t r = 0; r < registers; ++r) c.part[r] = condition.bits[r] ? yes.part[r] : no.part[r];
        return c;
    }
    [[gnu::always_inline]] friend Wide magnitude(const Wide& a) { return select(a > Wide(0.0), a, -a); }
#define COGLESS_COMPARISON(op)                                                          \
    [[gnu::always_inline]] friend Mask operator op(const Wide& a, const Wide& b) {      \
        Mask m;                                                                         \
        for (std::size_t r = 0; r < registers; ++r) m.bits[r] = a.part[r] op b.part[r]; \
        return m;                                                                       \
    }
    COGLESS_COMPARISON(>)
    COGLESS_COMPARISON(>=)
#undef COGLESS_COMPARISON
};

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
[[gnu::always_inline]] inline Four truncated(const Four& x) {
    typedef std::int32_t Whole __attribute__((vector_size(8)));
    Four whole;
    for (std::size_t r = 0; r < 2; ++r) {
        whole.part[r] = __builtin_convertvector(__builtin_convertvector(x.part[r], Whole), Four::Register);
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
