// Stub of hardware_interface: loaned interfaces over one double each.
#pragma once
#include <optional>
#include <string>
#include <utility>

namespace hardware_interface
{
struct Handle
{
  std::string name;
  std::optional<double> value;
};

class LoanedStateInterface
{
public:
  explicit LoanedStateInterface(const Handle * handle) : handle_(handle) {}
  LoanedStateInterface(const LoanedStateInterface &) = delete;
  LoanedStateInterface(LoanedStateInterface &&) = default;
  template<typename T = double>
  [[nodiscard]] std::optional<T> get_optional(unsigned int = 10) const {return handle_->value;}

private:
  const Handle * handle_;
};

class LoanedCommandInterface
{
public:
  explicit LoanedCommandInterface(Handle * handle) : handle_(handle) {}
  LoanedCommandInterface(const LoanedCommandInterface &) = delete;
  LoanedCommandInterface(LoanedCommandInterface &&) = default;
  template<typename T>
  [[nodiscard]] bool set_value(const T & value, unsigned int = 10)
  {
    handle_->value = value;
    return true;
  }

private:
  Handle * handle_;
};
}  // namespace hardware_interface
