// Stubs of what ros2_control.hpp uses of ROS 2: to compile it where there is none. They are no ROS 2. Below each "from"
// the declarations are, word for word, those of that header of ros2_control.
#pragma once

#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace rclcpp {
struct Time {};
struct Duration {
  double seconds() const { return 0.0; }
};
struct Parameter {
  std::string as_string() const { return {}; }
  double as_double() const { return 0.5; }
};
struct Logger {};
template <typename Message>
struct Subscription {};
template <typename Kind>
struct Service {};
}  // namespace rclcpp

namespace rclcpp_lifecycle {
struct State {};
struct LifecycleNode {
  rclcpp::Parameter get_parameter(const std::string&) const { return {}; }
  rclcpp::Logger get_logger() const { return {}; }
  template <typename Message, typename Callback>
  std::shared_ptr<rclcpp::Subscription<Message>> create_subscription(const std::string&, int, const Callback& callback) {
    callback(std::make_shared<const Message>());
    return {};
  }
  template <typename Kind, typename Callback>
  std::shared_ptr<rclcpp::Service<Kind>> create_service(const std::string&, const Callback& callback) {
    callback(std::make_shared<typename Kind::Request>(), std::make_shared<typename Kind::Response>());
    return {};
  }
};
namespace node_interfaces {
struct LifecycleNodeInterface {
  enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
  virtual ~LifecycleNodeInterface() = default;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
};
}  // namespace node_interfaces
}  // namespace rclcpp_lifecycle

namespace std_msgs::msg {
struct Float64MultiArray {
  std::vector<double> data;
};
}  // namespace std_msgs::msg

namespace std_srvs::srv {
struct Trigger {
  struct Request {};
  struct Response {
    bool success = false;
    std::string message;
  };
};
}  // namespace std_srvs::srv

#define RCLCPP_WARN(logger, ...) ((void)(logger), std::printf(__VA_ARGS__))
#define RCLCPP_ERROR(logger, ...) ((void)(logger), std::printf(__VA_ARGS__))

namespace hardware_interface {
// from hardware_interface/loaned_state_interface.hpp
class LoanedStateInterface {
 public:
  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional(unsigned int max_tries = 10) const {
    return std::optional<T>(T(max_tries));
  }
};
// from hardware_interface/loaned_command_interface.hpp
class LoanedCommandInterface {
 public:
  template <typename T>
  [[nodiscard]] bool set_value(const T & value, unsigned int max_tries = 10) {
    return value <= value && max_tries > 0U;
  }
};
// end
}  // namespace hardware_interface

namespace controller_interface {
// from controller_interface/controller_interface_base.hpp
using CallbackReturn = rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface::CallbackReturn;
enum class return_type : std::uint8_t {
  OK = 0,
  ERROR = 1,
};
enum class interface_configuration_type : std::uint8_t {
  ALL = 0,
  INDIVIDUAL = 1,
  NONE = 2,
};
struct InterfaceConfiguration {
  interface_configuration_type type;
  std::vector<std::string> names = {};
};
class ControllerInterfaceBase : public rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface {
 public:
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_init() = 0;
  virtual return_type update(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return std::make_shared<rclcpp_lifecycle::LifecycleNode>(); }
  unsigned int get_update_rate() const { return 0; }
  template <typename ParameterT>
  auto auto_declare(const std::string & name, const ParameterT & default_value) { return std::make_pair(name, default_value); }

 protected:
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;
};
// from controller_interface/controller_interface.hpp
class ControllerInterface : public controller_interface::ControllerInterfaceBase {
};
// end
}  // namespace controller_interface
