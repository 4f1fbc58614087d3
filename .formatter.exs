# The words of a robot's declaration.
locals_without_parens =
  [settings: 1, parameters: 1, sensors: 1, controllers: 1, topology: 1] ++
    [param: 2, param: 3, group: 2, link: 1, link: 2, joint: 1, joint: 2, joint: 3] ++
    [sensor: 2, sensor: 3, sensor: 4, actuator: 2, actuator: 3, actuator: 4] ++
    [controller: 2, controller: 3, controller: 4] ++
    [simulation: 1, i2c: 1, i2c: 2, i2c: 3, gpio: 1, gpio: 2, gpio: 3, device: 2, device: 3] ++
    [
      name: 1,
      topic_prefix: 1,
      parameter_store: 1,
      registry_module: 1,
      registry_options: 1,
      supervisor_module: 1
    ] ++
    [type: 1, default: 1, min: 1, max: 1, doc: 1] ++
    [origin: 1, axis: 1, limit: 1, dynamics: 1] ++
    [transmission: 1, reduction: 1, offset: 1, reversed?: 1] ++
    [required: 1, retain: 1, max_silence: 1] ++
    [x: 1, y: 1, z: 1, roll: 1, pitch: 1, yaw: 1] ++
    [lower: 1, upper: 1, effort: 1, velocity: 1, damping: 1, friction: 1]

[
  inputs: ["{mix,.formatter}.exs", "{bench,config,examples,lib,rel,test}/**/*.{ex,exs}"],
  locals_without_parens: locals_without_parens,
  export: [locals_without_parens: locals_without_parens]
]
