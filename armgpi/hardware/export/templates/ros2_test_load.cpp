// The controller manager of the ROS 2 that is here loads the plugin; as the tests of ros2_controllers do.
#include <memory>

#include <controller_manager/controller_manager.hpp>
#include <gmock/gmock.h>
#include <rclcpp/executors/single_threaded_executor.hpp>
#include <rclcpp/utilities.hpp>
#include <ros2_control_test_assets/descriptions.hpp>

TEST(TestLoad, the_controller_is_loaded) {
  rclcpp::init(0, nullptr);
  std::shared_ptr<rclcpp::Executor> executor = std::make_shared<rclcpp::executors::SingleThreadedExecutor>();
  controller_manager::ControllerManager manager(executor, ros2_control_test_assets::minimal_robot_urdf, true, "manager");
  ASSERT_NE(manager.load_controller("arm", "armgpi_controller/Ros2Controller"), nullptr);
  rclcpp::shutdown();
}
