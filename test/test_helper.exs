BB.Test.Probe.setup()
BB.Test.Servo.setup()
BB.Test.Brake.setup()
BB.Test.FlakyStore.setup()
BB.Test.Mischief.setup()
BB.Test.Run.begin()

# Events arrive at once unless the machine is busy, so that waits have a long timeout.
ExUnit.start(
  capture_log: true,
  assert_receive_timeout: 60_000,
  timeout: 600_000,
  exclude: [:docs, :new, :project, :release]
)
