defmodule BB.Parameter.Changed do
  @moduledoc """
  The payload for a parameter that was set. `BB.Parameter` publishes it on `[:param | path]` with
  the frame_id `:parameter`.

      {:ok, _} = BB.subscribe(MyRobot, [:param, :imu])

      receive do
        {:bb, [:param, :imu, :rate], %{payload: %BB.Parameter.Changed{new_value: rate}}} -> rate
      end

  `source` is the origin of the value:

    * `:local` - `BB.Parameter.set/3` or `set_many/2`; the default
    * `:remote` - a device or a program outside of the robot, by a bridge
    * `:init` - the default, when the robot starts or the parameter is registered
    * `:persisted` - the store, when the robot starts or the parameter is registered
    * `:startup` - `start_link(params: …)`

  `old_value` is `nil` for the last three, and where it is unknown. When the message arrives,
  `BB.Parameter.get/2` returns its value or a newer one.
  """

  @sources [:local, :remote, :init, :persisted, :startup]

  defstruct [:path, :old_value, :new_value, source: :local]

  @type source :: :local | :remote | :init | :persisted | :startup

  @type t :: %__MODULE__{
          path: BB.Parameter.path(),
          old_value: term(),
          new_value: term(),
          source: source()
        }

  use BB.Message,
    schema: [
      path: [type: {:list, :atom}, required: true, doc: "The path of the parameter."],
      old_value: [type: :any, default: nil, doc: "The value before."],
      new_value: [type: :any, required: true, doc: "The value now."],
      source: [type: {:in, @sources}, default: :local, doc: "The origin of the value."]
    ]
end
