// Floats that count what is done to them: included before a controller's C sources, compiled as C++20.
#pragma once
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <ctime>

extern long operations;

struct Counted {
    float x;
    Counted() = default;
    template <class T> constexpr Counted(T value) : x(static_cast<float>(value)) {}
    explicit operator double() const { return x; }
    Counted operator-() const { return Counted(-x); }
    Counted &operator+=(Counted o) { ++operations; x += o.x; return *this; }
    Counted &operator-=(Counted o) { ++operations; x -= o.x; return *this; }
    Counted &operator*=(Counted o) { ++operations; x *= o.x; return *this; }
    friend Counted operator+(Counted a, Counted b) { ++operations; return Counted(a.x + b.x); }
    friend Counted operator-(Counted a, Counted b) { ++operations; return Counted(a.x - b.x); }
    friend Counted operator*(Counted a, Counted b) { ++operations; return Counted(a.x * b.x); }
    friend Counted operator/(Counted a, Counted b) { ++operations; return Counted(a.x / b.x); }
    friend bool operator<(Counted a, Counted b) { ++operations; return a.x < b.x; }
    friend bool operator>(Counted a, Counted b) { ++operations; return a.x > b.x; }
    friend bool operator<=(Counted a, Counted b) { ++operations; return a.x <= b.x; }
    friend bool operator>=(Counted a, Counted b) { ++operations; return a.x >= b.x; }
    friend bool operator==(Counted a, Counted b) { ++operations; return a.x == b.x; }
    friend bool operator!=(Counted a, Counted b) { ++operations; return a.x != b.x; }
};

inline Counted sqrtf(Counted a) { ++operations; return Counted(std::sqrt(a.x)); }
inline Counted sinf(Counted a) { ++operations; return Counted(std::sin(a.x)); }
inline Counted cosf(Counted a) { ++operations; return Counted(std::cos(a.x)); }
inline Counted fabsf(Counted a) { ++operations; return Counted(std::fabs(a.x)); }
inline Counted atan2f(Counted a, Counted b) { ++operations; return Counted(std::atan2(a.x, b.x)); }
inline Counted powf(Counted a, Counted b) { ++operations; return Counted(std::pow(a.x, b.x)); }
inline Counted fmaxf(Counted a, Counted b) { ++operations; return Counted(std::fmax(a.x, b.x)); }
inline Counted fminf(Counted a, Counted b) { ++operations; return Counted(std::fmin(a.x, b.x)); }
inline Counted expf(Counted a) { ++operations; return Counted(std::exp(a.x)); }
inline Counted hypotf(Counted a, Counted b) { ++operations; return Counted(std::hypot(a.x, b.x)); }
inline Counted copysignf(Counted a, Counted b) { ++operations; return Counted(std::copysign(a.x, b.x)); }
inline bool isfinite(Counted a) { ++operations; return std::isfinite(a.x); }
#undef INFINITY
#define INFINITY __builtin_inff()
#define float Counted
