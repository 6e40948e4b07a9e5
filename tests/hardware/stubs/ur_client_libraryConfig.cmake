# The stub of this folder in place of the library.
add_library(ur_client_library::urcl INTERFACE IMPORTED)
target_include_directories(ur_client_library::urcl INTERFACE "${CMAKE_CURRENT_LIST_DIR}")
