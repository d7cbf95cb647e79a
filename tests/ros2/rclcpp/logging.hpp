// Stub of rclcpp: what the exported plugin uses of it, with Jazzy's signatures.
#pragma once
#include <cstdint>
#include <cstdio>

namespace rclcpp
{
class Logger {};

class Time
{
public:
  explicit Time(int64_t nanoseconds = 0) : nanoseconds_(nanoseconds) {}
  int64_t nanoseconds() const {return nanoseconds_;}

private:
  int64_t nanoseconds_;
};

class Duration
{
public:
  explicit Duration(int64_t nanoseconds = 0) : nanoseconds_(nanoseconds) {}
  int64_t nanoseconds() const {return nanoseconds_;}

private:
  int64_t nanoseconds_;
};
}  // namespace rclcpp

#define RCLCPP_ERROR(logger, ...) ((void)(logger), (void)std::fprintf(stderr, __VA_ARGS__))
