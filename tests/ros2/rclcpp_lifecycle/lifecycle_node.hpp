// Stub of rclcpp_lifecycle: a node that holds parameters.
#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <variant>
#include <vector>

#include "rclcpp/logging.hpp"

namespace rclcpp
{
using ParameterValue = std::variant<std::string, std::vector<std::string>>;

class Parameter
{
public:
  explicit Parameter(ParameterValue value) : value_(std::move(value)) {}
  std::string as_string() const {return std::get<std::string>(value_);}
  std::vector<std::string> as_string_array() const {return std::get<std::vector<std::string>>(value_);}
  template<typename T>
  T get_value() const {return std::get<T>(value_);}

private:
  ParameterValue value_;
};
}  // namespace rclcpp

namespace rclcpp_lifecycle
{
class State {};

class LifecycleNode
{
public:
  bool has_parameter(const std::string & name) const {return values_.count(name) > 0;}
  rclcpp::Parameter get_parameter(const std::string & name) const {return rclcpp::Parameter(values_.at(name));}
  rclcpp::Logger get_logger() const {return {};}
  template<typename T>
  T declare_parameter(const std::string & name, const T & value)
  {
    values_[name] = value;
    return value;
  }
  void set(const std::string & name, const rclcpp::ParameterValue & value) {values_[name] = value;}

private:
  std::map<std::string, rclcpp::ParameterValue> values_;
};

namespace node_interfaces
{
class LifecycleNodeInterface
{
public:
  enum class CallbackReturn : uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
  virtual ~LifecycleNodeInterface() = default;
  virtual CallbackReturn on_configure(const State &) {return CallbackReturn::SUCCESS;}
  virtual CallbackReturn on_activate(const State &) {return CallbackReturn::SUCCESS;}
  virtual CallbackReturn on_deactivate(const State &) {return CallbackReturn::SUCCESS;}
};
}  // namespace node_interfaces
}  // namespace rclcpp_lifecycle
