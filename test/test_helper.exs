BB.Test.Probe.setup()
BB.Test.Brake.setup()
BB.Test.FlakyStore.setup()
ExUnit.start(capture_log: true, assert_receive_timeout: 2_000, exclude: [:release])
