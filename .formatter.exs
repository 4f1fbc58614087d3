# The words of a robot's declaration, with the numbers of their arguments. BB.Dsl.Grammar has
# the table; a test compares both.
words = fn names, arities -> for name <- names, arity <- arities, do: {name, arity} end

entities =
  words.(
    ~w(settings parameters sensors controllers commands states topology simulation
       transmission origin axis limit dynamics inertial inertia visual box cylinder sphere
       capsule mesh color texture)a,
    1..2
  ) ++
    words.(
      ~w(link joint output collision material param group command category state i2c gpio)a,
      1..3
    ) ++
    words.(
      ~w(input argument)a,
      1..4
    ) ++
    words.(
      ~w(sensor actuator controller bridge estimator device)a,
      2..4
    )

fields =
  words.(
    ~w(name topic_prefix parameter_store registry_module registry_options supervisor_module
       topology_max_restarts topology_max_seconds initial_state type required retain
       max_silence simulation sync_tolerance latency_budget lost_after recover_after
       on_degraded on_lost on_recovered path driver? reduction offset reversed? x y z roll
       pitch yaw lower upper effort velocity acceleration damping friction mass ixx iyy izz
       ixy ixz iyz radius height filename scale red green blue alpha doc default min max
       handler timeout allowed_states category cancel arm disarm concurrency_limit clock_hz
       lines label labels timestamp_offset_ns)a,
    [1]
  )

locals_without_parens = Enum.uniq(entities ++ fields)

[
  inputs: [
    "{mix,.formatter}.exs",
    "{bench,config,examples,lib,rel,test}/**/*.{ex,exs}",
    "packages/*/{mix,.formatter}.exs",
    "packages/*/lib/**/*.ex"
  ],
  locals_without_parens: locals_without_parens,
  export: [locals_without_parens: locals_without_parens]
]
