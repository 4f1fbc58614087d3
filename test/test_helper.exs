BB.Test.Probe.setup()
BB.Test.Brake.setup()
BB.Test.FlakyStore.setup()
BB.Test.Mischief.setup()
BB.Test.Run.begin()

# What a test waits for comes at once, unless the machine is busy with something else: then it may take its time.
ExUnit.start(
  capture_log: true,
  assert_receive_timeout: 60_000,
  timeout: 600_000,
  exclude: [:docs, :new, :project, :release]
)
