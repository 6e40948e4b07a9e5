# The stub of this folder in place of the library.
add_library(Franka::Franka INTERFACE IMPORTED)
target_include_directories(Franka::Franka INTERFACE "${CMAKE_CURRENT_LIST_DIR}")
