// Registers the plugin.
#include "armgpi_controller/ros2_control.hpp"

#ifndef ARMGPI_ROS2_STUBS
#include <pluginlib/class_list_macros.hpp>
PLUGINLIB_EXPORT_CLASS(armgpi_controller::Ros2Controller, controller_interface::ChainableControllerInterface)
#else
template class std::array<armgpi_real_t, ARMGPI_N>;
controller_interface::ChainableControllerInterface* armgpi_make() { return new armgpi_controller::Ros2Controller(); }
#endif
