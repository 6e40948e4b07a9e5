// What fci.hpp uses of libfranka: enough to compile it, and no more. Compared by tools/headers.py.
#pragma once
#include <array>
#include <functional>
#include "../wire.h"
#include "duration.h"
#include "exception.h"
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
  std::array<double, 7> theta{};
  Duration time{};
};
// from franka/lowpass_filter.h
constexpr double kMaxCutoffFrequency = 1000.0;
// end
// A robot whose arm is at the other end of the wire: milliseconds since the last packet, q, tau_J_d -> torques.
class Robot {
 public:
  explicit Robot(const std::string&) {}
  // libfranka's keeps a copy of the callback, as std::function does.
  void control(std::function<Torques(const RobotState&, franka::Duration)> control_callback, bool limit_rate,
               double cutoff_frequency) {
    RobotState state;
    for (uint64_t passed = 0; packet(state, passed);) {
      const Torques torques = control_callback(state, Duration(passed));
      wire::send(limit_rate || cutoff_frequency < kMaxCutoffFrequency ? "filtered" : "tau", torques.tau_J);
      if (torques.motion_finished) return;
    }
    throw Exception("the motion was stopped by a reflex");
  }
// from franka/robot.h
  void read(std::function<bool(const RobotState&)> read_callback)
// end
  {
    RobotState state;
    for (uint64_t passed = 0; packet(state, passed) && read_callback(state);) {
      wire::send("look", state.q);
    }
  }
// from franka/robot.h
  void setCollisionBehavior(const std::array<double, 7>& lower_torque_thresholds,
                            const std::array<double, 7>& upper_torque_thresholds,
                            const std::array<double, 6>& lower_force_thresholds,
                            const std::array<double, 6>& upper_force_thresholds)
// end
  {
    wire::send("contact", lower_torque_thresholds);
    wire::send("contact", upper_torque_thresholds);
    wire::send("force", lower_force_thresholds);
    wire::send("force", upper_force_thresholds);
  }
// from franka/robot.h
  void setLoad(double load_mass,
               const std::array<double, 3>& F_x_Cload,
               const std::array<double, 9>& load_inertia)
// end
  {
    wire::send("load", std::array<double, 3>{{load_mass, F_x_Cload[0], load_inertia[8]}});
  }
// from franka/robot.h
  void automaticErrorRecovery()
// end
  {
    wire::send("recover", std::array<double, 0>{});
  }

 private:
  bool packet(RobotState& state, uint64_t& passed) {
    std::array<double, 15> numbers{};
    const bool found = wire::take(numbers);
    passed = static_cast<uint64_t>(numbers[0]);
    for (std::size_t i = 0; i < 7U; ++i) {
      state.q[i] = numbers[1U + i];
      state.theta[i] = numbers[1U + i];
      state.tau_J_d[i] = numbers[8U + i];
    }
    time_ += passed;
    state.time = Duration(time_);
    return found;
  }
  uint64_t time_{0};
};
}  // namespace franka
