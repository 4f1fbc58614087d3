defmodule BB.Sensor.EmergencyStopConformanceTest do
  # A wire that is cut is a pressed button: it is published, and no fault of the sensor's.
  use BB.Sensor.Conformance,
    driver: {BB.Sensor.EmergencyStop, &[line: {&1.chip, 27}]},
    device: {BB.Bus.Sim.Contact, pins: [contact: 27], normally: :closed},
    new_options: [rate: 20],
    unseen: [:unplug, :cut, :short]
end
