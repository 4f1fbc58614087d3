BB.Test.Probe.setup()
ExUnit.start(capture_log: true)
