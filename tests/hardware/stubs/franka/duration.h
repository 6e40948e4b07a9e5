// What fci.hpp uses of libfranka: enough to compile it, and no more. Compared by tools/headers.py.
#pragma once
#include <cstdint>
namespace franka {
// from franka/duration.h
class Duration {
 public:
  Duration() noexcept
// end
      {}
// from franka/duration.h
  explicit Duration(uint64_t milliseconds) noexcept
// end
      : milliseconds_(milliseconds) {}
// from franka/duration.h
  double toSec() const noexcept { return 0.001 * static_cast<double>(milliseconds_); }
// end
 private:
  uint64_t milliseconds_{0};
};
}  // namespace franka
