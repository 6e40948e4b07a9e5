// What ur.hpp and ur.cpp use of UR's client library: enough to compile them, and no more. Compared by tools/headers.py.
#pragma once
#include <array>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>
#include "../../wire.h"
namespace urcl {
// from ur_client_library/types.h
using vector6d_t = std::array<double, 6>;
// from ur_client_library/ur/version_information.h
class VersionInformation
{
public:
  uint32_t major;
  uint32_t minor;
  uint32_t bugfix;
  uint32_t build;
};
// end
namespace comm {
// from ur_client_library/comm/control_mode.h
enum class ControlMode : int32_t
{
  MODE_TORQUE = 8,
};
// from ur_client_library/comm/tcp_socket.h
class TCPSocket
{
public:
  static constexpr std::chrono::milliseconds DEFAULT_RECONNECTION_TIME{ 10000 };
};
// from ur_client_library/comm/pipeline.h
class INotifier
{
};
// end
}  // namespace comm
// from ur_client_library/ur/robot_receive_timeout.h
class RobotReceiveTimeout
{
public:
  static RobotReceiveTimeout millisec(const unsigned int milliseconds = 20)
// end
  { return {milliseconds}; }
  unsigned int time;
};
namespace rtde_interface {
// from ur_client_library/rtde/data_package.h
class DataPackage
{
public:
  DataPackage(const std::vector<std::string>& recipe, const uint16_t& protocol_version = 2)
// end
  : named(recipe) { version = protocol_version; }
// from ur_client_library/rtde/data_package.h
  template <typename T>
  bool getData(const std::string& name, T& val) const
// end
  { return read(name, val); }
  bool read(const std::string& name, double& x) const { x = numbers[0]; return name == "timestamp" && has(name); }
  bool read(const std::string& name, vector6d_t& x) const {
    const std::size_t first = name == "actual_q" ? 1U : 7U;
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = numbers[first + i];
    return (name == "actual_q" || name == "target_moment") && has(name);
  }
  bool has(const std::string& name) const {
    for (const std::string& each : named) if (each == name) return true;
    return false;
  }
  std::vector<std::string> named;
  uint16_t version = 2;
  std::array<double, 13> numbers{};
};
// A robot that says its time, q and the torques that it aims at, and where no more come somebody presses Ctrl-C.
// from ur_client_library/rtde/rtde_client.h
static const int UR_RTDE_PORT = 30004;
class RTDEClient
{
public:
  RTDEClient(std::string robot_ip, comm::INotifier& notifier, const std::vector<std::string>& output_recipe,
             const std::vector<std::string>& input_recipe, double target_frequency = 0.0,
             bool ignore_unavailable_outputs = false, const uint32_t port = UR_RTDE_PORT)
// end
  : output_recipe_(output_recipe) {
    static_cast<void>(notifier);
    const bool alone = input_recipe.empty() && !ignore_unavailable_outputs;
    if (robot_ip.empty() || port != 30004U || target_frequency != 500.0 || !alone) throw std::runtime_error("not so");
  }
// from ur_client_library/rtde/rtde_client.h
  bool init(const size_t max_connection_attempts = 0,
            const std::chrono::milliseconds reconnection_timeout = comm::TCPSocket::DEFAULT_RECONNECTION_TIME,
            const size_t max_initialization_attempts = 3,
            const std::chrono::milliseconds initialization_timeout = std::chrono::seconds(1))
// end
  {
    return max_connection_attempts + max_initialization_attempts > 0U && reconnection_timeout > initialization_timeout;
  }
// from ur_client_library/rtde/rtde_client.h
  bool start(const bool read_packages_in_background = true)
// end
  { return read_packages_in_background; }
// from ur_client_library/rtde/rtde_client.h
  bool getDataPackage(DataPackage& data_package, std::chrono::milliseconds timeout)
// end
  {
    if (!wire::take(data_package.numbers)) std::raise(SIGINT);
    return timeout.count() > 0;
  }
// from ur_client_library/rtde/rtde_client.h
  std::vector<std::string> getOutputRecipe()
  {
    return output_recipe_;
  }
// end
 private:
  std::vector<std::string> output_recipe_;
};
}  // namespace rtde_interface
// from ur_client_library/ur/ur_driver.h
struct UrDriverConfiguration
{
  std::string robot_ip;
  std::string script_file;
  std::vector<std::string> output_recipe;
  std::function<void(bool)> handle_program_state = nullptr;
  bool headless_mode;
};
// end
// A robot whose arm is at the other end of the wire: its time and q -> torques. Its address is its version.
// from ur_client_library/ur/ur_driver.h
class UrDriver
{
public:
  explicit UrDriver(const UrDriverConfiguration& config)
// end
  : recipe_(config.output_recipe) {
    if (std::sscanf(config.robot_ip.c_str(), "%u.%u.%u", &version_.major, &version_.minor, &version_.bugfix) != 3) {
      throw std::runtime_error("no robot there");
    }
    if (config.headless_mode && !config.script_file.empty()) config.handle_program_state(true);
  }
// from ur_client_library/ur/ur_driver.h
  bool getDataPackage(rtde_interface::DataPackage& data_package)
// end
  {
    std::array<double, 7> both{};
    const bool heard = started_ && wire::take(both);
    for (std::size_t i = 0; i < both.size(); ++i) data_package.numbers[i] = both[i];
    return heard;
  }
// from ur_client_library/ur/ur_driver.h
  bool writeJointCommand(const vector6d_t& values, const comm::ControlMode control_mode,
                         const RobotReceiveTimeout& robot_receive_timeout = RobotReceiveTimeout::millisec(20))
// end
  {
    wire::send(control_mode == comm::ControlMode::MODE_TORQUE ? "tau" : "other", values);
    return robot_receive_timeout.time > 0U;
  }
// from ur_client_library/ur/ur_driver.h
  bool setFrictionScales(const vector6d_t& viscous_scale, const vector6d_t& coulomb_scale)
// end
  {
    wire::send("viscous", viscous_scale);
    wire::send("coulomb", coulomb_scale);
    return true;
  }
// from ur_client_library/ur/ur_driver.h
  void startRTDECommunication(const bool read_packages_in_background = true)
// end
  { started_ = read_packages_in_background; }
// from ur_client_library/ur/ur_driver.h
  bool stopControl()
// end
  { wire::send("stopped", std::array<double, 0>{}); return true; }
// from ur_client_library/ur/ur_driver.h
  const VersionInformation& getVersion()
// end
  { return version_; }
// from ur_client_library/ur/ur_driver.h
  std::vector<std::string> getRTDEOutputRecipe()
// end
  { return recipe_; }

 private:
  std::vector<std::string> recipe_;
  VersionInformation version_{};
  bool started_{false};
};
}  // namespace urcl
