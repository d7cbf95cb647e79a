// The plugin through a controller manager's calls, beside the C controller: ends with 1 where a torque differs.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <vector>

#include "controller_interface/controller_interface.hpp"

extern "C" {
#include "gimbal_controller.h"
}

std::shared_ptr<controller_interface::ControllerInterface> made_by_pluginlib();

using controller_interface::CallbackReturn;

static int fail(const char * what)
{
  std::puts(what);
  return 1;
}

int main()
{
  const auto controller = made_by_pluginlib();
  const rclcpp_lifecycle::State state;
  if (controller->on_init() != CallbackReturn::SUCCESS) {
    return fail("on_init");
  }
  controller->rate = 37;
  if (controller->on_configure(state) != CallbackReturn::FAILURE) {
    return fail("a wrong rate is taken");
  }
  controller->rate = 1000;
  controller->get_node()->set("link_imus", std::vector<std::string>{"a", "b", "c", "d", "e"});
  if (controller->on_configure(state) != CallbackReturn::FAILURE) {
    return fail("wrong IMUs are taken");
  }
  const auto again = made_by_pluginlib();
  again->rate = 1000;
  if (again->on_init() != CallbackReturn::SUCCESS || again->on_configure(state) != CallbackReturn::SUCCESS) {
    return fail("on_configure");
  }
  std::vector<hardware_interface::Handle> sensors, motors;
  for (const auto & name : again->state_interface_configuration().names) {
    sensors.push_back({name, 0.0});
    std::puts(name.c_str());
  }
  for (const auto & name : again->command_interface_configuration().names) {
    motors.push_back({name, 99.0});
    std::puts(name.c_str());
  }
  std::vector<hardware_interface::LoanedStateInterface> states;
  std::vector<hardware_interface::LoanedCommandInterface> commands;
  for (const auto & sensor : sensors) {
    states.emplace_back(&sensor);
  }
  for (auto & motor : motors) {
    commands.emplace_back(&motor);
  }
  again->assign_interfaces(std::move(commands), std::move(states));
  if (again->on_activate(state) != CallbackReturn::SUCCESS) {
    return fail("on_activate");
  }
  static gimbal_holding held;
  gimbal_sensors seen;
  float tau[GIMBAL_JOINTS];
  double most = 0.0;
  std::memset(&seen, 0, sizeof seen);
  for (int k = 0; k < 200; ++k) {
    for (std::size_t i = 0; i < sensors.size(); ++i) {
      sensors[i].value = 0.1 * std::sin(0.01 * (k + 1) * static_cast<double>(i + 1)) + (i == GIMBAL_JOINTS + 8 ? 9.81 : 0.0);
    }
    if (k == 50) {
      sensors[0].value.reset();  // a value that cannot be had: the guard bridges it
    }
    float * to[] = {seen.q, seen.camera_gyro, seen.base_gyro, seen.base_force, seen.link_gyro[0]};
    const std::size_t sizes[] = {GIMBAL_JOINTS, 3, 3, 3, sensors.size() - GIMBAL_JOINTS - 9};
    for (std::size_t part = 0, at = 0; part < 5; ++part) {
      for (std::size_t i = 0; i < sizes[part]; ++i, ++at) {
        to[part][i] = static_cast<float>(sensors[at].value.value_or(NAN));
      }
    }
    const rclcpp::Time now(1700000000000000000 + k * INT64_C(1000000));
    seen.time_us = static_cast<uint32_t>(now.nanoseconds() / 1000);
    if (k == 0) {
      gimbal_attitudes known;
      gimbal_attitudes_now(seen.q, &known);
      gimbal_holding_start(&gimbal_default_parameters, &held, &seen, &known);
    }
    gimbal_holding_step(&gimbal_default_parameters, &held, &seen, tau);
    if (again->update(now, rclcpp::Duration(1000000)) != controller_interface::return_type::OK) {
      return fail("update");
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
      if (motors[j].value != static_cast<double>(tau[j])) {
        return fail("another torque");
      }
      most = std::fmax(most, std::fabs(*motors[j].value));
    }
  }
  if (!(most > 0.0) || again->on_deactivate(state) != CallbackReturn::SUCCESS || motors[0].value != 0.0) {
    return fail("no torque, or one that stays");
  }
  std::puts("200 updates equal");
}
