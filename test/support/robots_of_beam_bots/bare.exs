# The smallest robots: nothing, one link, and no topology.
defmodule BB.Test.BeamBots.Nothing do
  use BB
end

defmodule BB.Test.BeamBots.OneLink do
  use BB, extensions: []

  topology do
    link(:base, do: nil)
  end
end

defmodule BB.Test.BeamBots.Station do
  use BB

  parameters do
    param(:interval, type: :pos_integer, default: 10)
  end

  sensors do
    sensor :power, BB.Test.BeamBots.Ticker do
    end
  end
end
