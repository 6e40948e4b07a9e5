// What ur.hpp and ur.cpp use of UR's client library: enough to compile them, and no more. Compared by tools/headers.py.
#pragma once
#include <array>
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
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = numbers[1U + i];
    return name == "actual_q" && has(name);
  }
  bool has(const std::string& name) const {
    for (const std::string& each : named) if (each == name) return true;
    return false;
  }
  std::vector<std::string> named;
  uint16_t version = 2;
  std::array<double, 7> numbers{};
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
  { return started_ && wire::take(data_package.numbers); }
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
