// What a controller manager does with the plugin, around ros2_stubs.hpp: configure, activate, update, deactivate. Its
// hardware is at the other end of the wire: seconds since the last update, positions -> torques. Arguments: goals, the first
// by the topic, later ones when they are taken, or pose:x,y,z,qx,qy,qz,qw, a pose by its topic. TOPIC@SAMPLE:x,y,... before
// them, such as stiffness@300:50,50, are numbers by a topic at a sample; guide@SAMPLE:1 calls that service. Ctrl-C calls the
// service that stops the arm.
#include <csignal>

#include "armgpi_controller/ros2_control.hpp"
#include "wire.h"

struct Manager : armgpi_controller::Ros2Controller {
  void wire() {
    command_interfaces_.resize(ARMGPI_N);
    state_interfaces_.resize(ARMGPI_N);
  }
  void measured(std::size_t i, double q) { stubs::values[&state_interfaces_[i]] = q; }
  double commanded(std::size_t i) { return stubs::values[&command_interfaces_[i]]; }
  controller_interface::return_type cycle(double period) {
    const rclcpp::Duration passed{period};
    const auto first = update_reference_from_subscribers(rclcpp::Time{}, passed);
    const auto second = update_and_write_commands(rclcpp::Time{}, passed);
    return first == second ? first : controller_interface::return_type::ERROR;
  }
};

volatile std::sig_atomic_t interrupted = 0;

// "0.1,-0.2,..." -> numbers.
std::vector<double> numbers(const char* at) {
  std::vector<double> found;
  char* end = nullptr;
  for (double x = std::strtod(at, &end); end != at; x = std::strtod(at, &end)) {
    found.push_back(x);
    at = *end == ',' ? end + 1 : end;
  }
  return found;
}

// What comes by a topic, or a service, at a sample.
struct Change {
  explicit Change(const std::string& word)
      : topic(word.substr(0, word.find('@'))),
        sample(std::strtol(word.c_str() + word.find('@') + 1U, nullptr, 10)),
        values(numbers(word.c_str() + word.find(':') + 1U)) {}
  void publish() const {
    if (topic == "guide") {
      auto asked = std::make_shared<std_srvs::srv::SetBool::Request>();
      asked->data = values.at(0) > 0.0;
      rclcpp::Service<std_srvs::srv::SetBool>::callback(asked, std::make_shared<std_srvs::srv::SetBool::Response>());
      return;
    }
    auto message = std::make_shared<std_msgs::msg::Float64MultiArray>();
    message->data = values;
    rclcpp::Subscription<std_msgs::msg::Float64MultiArray>::callbacks.at("~/" + topic)(message);
  }
  std::string topic;
  long sample;
  std::vector<double> values;
};

int main(int argc, char* argv[]) {
  using Return = controller_interface::CallbackReturn;
  stubs::parameters<armgpi_controller::Params>.log = "motion.armlog";
  stubs::update_rate = static_cast<unsigned int>(1.0 / armgpi_controller::Controller::dt + 0.5);
  Manager manager;
  const rclcpp_lifecycle::State none{};
  if (manager.on_init() != Return::SUCCESS || manager.on_configure(none) != Return::SUCCESS) return 1;
  manager.wire();
  std::signal(SIGINT, [](int) { interrupted = 1; });
  std::array<double, 1U + ARMGPI_N> seen{};
  bool active = false;
  std::vector<Change> changes;
  int given = 1;
  for (; given < argc && std::string(argv[given]).find('@') != std::string::npos; ++given) changes.emplace_back(argv[given]);
  const int first = given;
  for (long sample = 0; wire::take(seen); ++sample) {
    for (const Change& change : changes) {
      if (change.sample == sample) change.publish();
    }
    for (std::size_t i = 0; i < ARMGPI_N; ++i) manager.measured(i, seen[1U + i]);
    active = active || manager.on_activate(none) == Return::SUCCESS;
    if (given < argc && std::string(argv[given]).rfind("pose:", 0) == 0) {
      const std::vector<double> x = numbers(argv[given] + 5);
      auto message = std::make_shared<geometry_msgs::msg::PoseStamped>();
      message->pose.position = {x[0], x[1], x[2]};
      message->pose.orientation = {x[3], x[4], x[5], x[6]};
      rclcpp::Subscription<geometry_msgs::msg::PoseStamped>::callbacks["~/target_pose"](message);
      given = argc;
    }
    armgpi_controller::Vector goal{};
    const char* at = given < argc ? argv[given] : "";
    for (auto& x : goal) {
      char* end = nullptr;
      x = static_cast<armgpi_real_t>(std::strtod(at, &end));
      at = *end == ',' ? end + 1 : end;
    }
    if (given == first && given < argc) {
      auto message = std::make_shared<std_msgs::msg::Float64MultiArray>();
      message->data.assign(goal.begin(), goal.end());
      rclcpp::Subscription<std_msgs::msg::Float64MultiArray>::callbacks["~/goal"](message);
      ++given;
    } else if (given < argc && manager.move_to(goal)) {
      ++given;
    }
    if (interrupted != 0) {
      interrupted = 0;
      rclcpp::Service<std_srvs::srv::Trigger>::callback(std::make_shared<std_srvs::srv::Trigger::Request>(),
                                                        std::make_shared<std_srvs::srv::Trigger::Response>());
    }
    if (!active || manager.cycle(seen[0]) != controller_interface::return_type::OK) break;
    if (!stubs::timers.empty()) stubs::timers.front()();
    std::array<double, ARMGPI_N> torque{};
    for (std::size_t i = 0; i < ARMGPI_N; ++i) torque[i] = manager.commanded(i);
    wire::send("tau", torque);
  }
  const bool ended = manager.on_deactivate(none) == Return::SUCCESS;
  for (const std::string& text : stubs::published) std::fprintf(stderr, "%s\n", text.c_str());
  return active && ended ? 0 : 1;
}
