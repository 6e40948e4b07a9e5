// What fci.hpp uses of libfranka: enough to compile it, and no more. Compared by tools/headers.py.
#pragma once
#include <array>
#include <functional>
#include "duration.h"
namespace franka {
// from franka/control_types.h
struct Finishable {
  bool motion_finished = false;
};
class Torques : public Finishable {
 public:
  Torques(const std::array<double, 7>& torques) noexcept
// end
      : tau_J(torques) {}
// from franka/control_types.h
  std::array<double, 7> tau_J{};
};
inline Torques MotionFinished(Torques command) noexcept {
  command.motion_finished = true;
  return command;
}
// from franka/robot_state.h
struct RobotState {
  std::array<double, 7> tau_J{};
  std::array<double, 7> tau_J_d{};
  std::array<double, 7> q{};
  std::array<double, 7> dq{};
  Duration time{};
};
// from franka/lowpass_filter.h
constexpr double kMaxCutoffFrequency = 1000.0;
// end
class Robot {
 public:
  // libfranka's keeps a copy of the callback, as std::function does.
  void control(std::function<Torques(const RobotState&, franka::Duration)> control_callback, bool limit_rate, double cutoff_frequency);
};
}  // namespace franka
