defmodule BB.Message.Firmware.RoundTrip do
  @moduledoc "What a guard of the firmware sends to itself, to see that it arrives. Published on `[:firmware, :guard]`."

  defstruct [:token]

  @type t :: %__MODULE__{token: integer()}

  use BB.Message,
    schema: [token: [type: :integer, required: true, doc: "The number of the attempt."]]
end
