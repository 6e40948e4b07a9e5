// What fci.cpp uses of libfranka. Compared by tools/headers.py.
#pragma once
#include <stdexcept>
namespace franka {
// from franka/exception.h
struct Exception : public std::runtime_error {
  using std::runtime_error::runtime_error;
};
// end
}  // namespace franka
