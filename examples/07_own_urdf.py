# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""A robot of your own, its URDF written out here: an arm that turns and a slide that goes in and out.

A name that armgpi knows, the path of a file or the text itself: after loading there is no difference. What
the URDF lacks or has wrong is said by name when it is loaded.
"""

import numpy as np

from armgpi import GPI, RigidBodyPlant, Robot, Waypoints, metrics, simulate
from armgpi.errors import UrdfError

URDF = """
<robot name="crane">
  <link name="post"/>
  <joint name="lift" type="revolute">
    <parent link="post"/> <child link="boom"/>
    <origin xyz="0 0 0.5"/> <axis xyz="0 -1 0"/>
    <limit lower="-0.5" upper="1.2" effort="80" velocity="2"/>
  </joint>
  <link name="boom">
    <inertial>
      <origin xyz="0.4 0 0"/> <mass value="3"/>
      <inertia ixx="0.005" iyy="0.16" izz="0.16" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="reach" type="prismatic">
    <parent link="boom"/> <child link="slide"/>
    <origin xyz="0.5 0 0"/> <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.4" effort="60" velocity="1"/>
    <dynamics damping="20" friction="4"/>
  </joint>
  <link name="slide">
    <inertial>
      <origin xyz="0.2 0 0"/> <mass value="1"/>
      <inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
</robot>
"""

crane = Robot.from_xml(URDF)
print(crane)
for joint, kind, low, high in zip(crane.joint_names, crane.joint_types, *crane.limits[:2], strict=True):
    print(f"  {joint}: {kind}, {low:g} to {high:g}")

# The plant has the friction that the URDF states; the controller takes it for one more disturbance.
plant = RigidBodyPlant(crane.with_payload("slide", mass=2.0, com=[0.4, 0.0, 0.0]), friction="urdf")
reference = Waypoints([[0.0, 0.1], [0.8, 0.35], [0.0, 0.1]], durations=1.2, holds=0.4)
rollout = simulate(plant, GPI(crane, dt=1e-3), reference, t_final=3.6)
for joint, error, torque in zip(
    crane.joint_names, metrics.peak_error(rollout).values, metrics.peak_torque(rollout).values, strict=True
):
    print(f"  {joint}: at most {error:.5f} off its reference, up to {torque:.1f} N m or N")

try:
    Robot.from_xml(URDF.replace('<mass value="1"/>', '<mass value="-1"/>'))
except UrdfError as error:
    print(f"and with a mistake in it: {error}")
assert np.isfinite(rollout["q"]).all()
