defmodule BB.Sensor.ContactSwitchConformanceTest do
  use BB.Sensor.Conformance,
    driver: {BB.Sensor.ContactSwitch, &[line: {&1.chip, 17}]},
    device: {BB.Bus.Sim.Contact, pins: [contact: 17]},
    new_options: [rate: 20],
    unseen: [:unplug, :cut, :short]
end
