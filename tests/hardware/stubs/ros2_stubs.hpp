// Stubs of what ros2_control.hpp uses of ROS 2: to compile it where there is none. They are no ROS 2. Below each "from"
// the declarations are, word for word, those of that header of ros2_control.
#pragma once

#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

// What a test sets and reads.
namespace stubs {
inline unsigned int update_rate = 0;
inline std::map<const void*, double> values;             // of interfaces
template <typename Params>
inline Params parameters{};
inline std::vector<std::string> published;               // std_msgs/String
inline std::vector<std::function<void()>> timers;
inline bool put(const void* interface, double value) {
  values[interface] = value;
  return true;
}
}  // namespace stubs

// What generate_parameter_library makes of src/armgpi_controller_parameters.yaml.
namespace armgpi_controller {
struct Params {
  std::string prefix = "";
  double share = 0.5;
  std::string last_torque = "zero";
  std::string log = "";
  double log_seconds = 60.0;
  bool dry_run = false;
  std::string motion = "";
  std::string base_frame = "";
};
class ParamListener {
 public:
  template <typename Node>
  explicit ParamListener(const std::shared_ptr<Node>&) {}
  Params get_params() const { return stubs::parameters<Params>; }
};
}  // namespace armgpi_controller

namespace rclcpp {
struct Time {};
struct Duration {
  double period = 0.0;
  double seconds() const { return period; }
};
struct Logger {};
// What is subscribed to, by its topic, and what answers: the last callback.
template <typename Message>
struct Subscription {
  static inline std::map<std::string, std::function<void(std::shared_ptr<const Message>)>> callbacks;
};
template <typename Kind>
struct Service {
  static inline std::function<void(std::shared_ptr<typename Kind::Request>, std::shared_ptr<typename Kind::Response>)> callback;
};
template <typename Message>
struct Publisher {
  void publish(const Message& message) { stubs::published.push_back(message.data); }
};
struct TimerBase {};
}  // namespace rclcpp

namespace rclcpp_lifecycle {
struct State {};
struct LifecycleNode {
  rclcpp::Logger get_logger() const { return {}; }
  const char* get_name() const { return "arm"; }
  template <typename Message>
  std::shared_ptr<rclcpp::Publisher<Message>> create_publisher(const std::string&, int) {
    return std::make_shared<rclcpp::Publisher<Message>>();
  }
  template <typename Time, typename Callback>
  std::shared_ptr<rclcpp::TimerBase> create_wall_timer(Time, const Callback& callback) {
    stubs::timers.emplace_back(callback);
    return std::make_shared<rclcpp::TimerBase>();
  }
  template <typename Message, typename Callback>
  std::shared_ptr<rclcpp::Subscription<Message>> create_subscription(const std::string& topic, int, const Callback& callback) {
    rclcpp::Subscription<Message>::callbacks[topic] = callback;
    return {};
  }
  template <typename Kind, typename Callback>
  std::shared_ptr<rclcpp::Service<Kind>> create_service(const std::string&, const Callback& callback) {
    rclcpp::Service<Kind>::callback = callback;
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
struct String {
  std::string data;
};
}  // namespace std_msgs::msg

namespace std_msgs::msg {
struct Header {
  std::string frame_id;
};
}  // namespace std_msgs::msg

namespace geometry_msgs::msg {
struct Point {
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
};
struct Quaternion {
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
  double w = 1.0;
};
struct Pose {
  Point position;
  Quaternion orientation;
};
struct PoseStamped {
  std_msgs::msg::Header header;
  Pose pose;
};
}  // namespace geometry_msgs::msg

namespace std_srvs::srv {
struct Trigger {
  struct Request {};
  struct Response {
    bool success = false;
    std::string message;
  };
};
struct SetBool {
  struct Request {
    bool data = false;
  };
  struct Response {
    bool success = false;
    std::string message;
  };
};
}  // namespace std_srvs::srv

#define RCLCPP_WARN(logger, ...) ((void)(logger), std::fprintf(stderr, __VA_ARGS__), std::fprintf(stderr, "\n"))
#define RCLCPP_ERROR(logger, ...) RCLCPP_WARN(logger, __VA_ARGS__)

namespace hardware_interface {
struct Handle {
  Handle(const std::string&, const std::string& interface_name, double* value_ptr) : name(interface_name), value(value_ptr) {}
  std::string name;
  double* value;
};
// from hardware_interface/handle.hpp
class CommandInterface : public Handle {
 public:
  using Handle::Handle;
};
// from hardware_interface/loaned_state_interface.hpp
class LoanedStateInterface {
 public:
  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional(unsigned int max_tries = 10) const {
    return max_tries > 0U ? std::optional<T>(T(stubs::values[this])) : std::nullopt;
  }
};
// from hardware_interface/loaned_command_interface.hpp
class LoanedCommandInterface {
 public:
  template <typename T>
  [[nodiscard]] bool set_value(const T & value, unsigned int max_tries = 10) {
    return stubs::put(this, value) && max_tries > 0U;
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
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return std::make_shared<rclcpp_lifecycle::LifecycleNode>(); }
  unsigned int get_update_rate() const { return stubs::update_rate; }

 protected:
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;
};
// from controller_interface/chainable_controller_interface.hpp
class ChainableControllerInterface : public ControllerInterfaceBase {
 public:
  bool set_chained_mode(bool chained_mode);
  bool is_in_chained_mode() const;

 protected:
  virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces();
  virtual return_type update_reference_from_subscribers(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
  virtual return_type update_and_write_commands(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
  std::vector<double> reference_interfaces_;
  bool in_chained_mode_ = false;
};
// end
inline bool ChainableControllerInterface::set_chained_mode(bool chained_mode) {
  in_chained_mode_ = chained_mode;
  return true;
}
inline bool ChainableControllerInterface::is_in_chained_mode() const { return in_chained_mode_; }
inline std::vector<hardware_interface::CommandInterface> ChainableControllerInterface::on_export_reference_interfaces() {
  return {};
}
}  // namespace controller_interface
