// Stubs of what ros2_control.hpp uses of ROS 2: to compile it where there is none. They are no ROS 2.
#pragma once

#include <memory>
#include <string>
#include <vector>

namespace rclcpp {
struct Time {};
struct Duration {
  double seconds() const { return 0.0; }
};
struct Parameter {
  std::string as_string() const { return {}; }
};
}  // namespace rclcpp

namespace rclcpp_lifecycle {
struct State {};
struct LifecycleNode {
  rclcpp::Parameter get_parameter(const std::string&) const { return {}; }
};
}  // namespace rclcpp_lifecycle

namespace controller_interface {
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration {
  interface_configuration_type type{};
  std::vector<std::string> names;
};
struct Interface {
  double get_value() const { return 0.0; }
  void set_value(double) {}
};
class ControllerInterface {
 public:
  virtual ~ControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
  virtual return_type update(const rclcpp::Time&, const rclcpp::Duration&) = 0;
  unsigned int get_update_rate() const { return 0; }

 protected:
  template <typename T>
  void auto_declare(const std::string&, const T&) {}
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return std::make_shared<rclcpp_lifecycle::LifecycleNode>(); }
  std::vector<Interface> command_interfaces_;
  std::vector<Interface> state_interfaces_;
};
}  // namespace controller_interface
