// The arm of a stub: what a program sends goes to standard output, and what the arm answers comes from standard input.
#pragma once
#include <array>
#include <cstdio>
#include <cstdlib>
#include <string>
namespace wire {
// A line of numbers; false when there is none any more.
template <std::size_t Count>
bool take(std::array<double, Count>& numbers) {
  for (double& x : numbers) {
    char word[64];
    if (std::scanf("%63s", word) != 1) return false;
    x = std::strtod(word, nullptr);
  }
  return true;
}
template <std::size_t Count>
void send(const char* what, const std::array<double, Count>& numbers) {
  std::printf("%s", what);
  for (double x : numbers) std::printf(" %.17g", x);
  std::printf("\n");
  std::fflush(stdout);
}
}  // namespace wire
