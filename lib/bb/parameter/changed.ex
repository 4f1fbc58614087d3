defmodule BB.Parameter.Changed do
  @moduledoc """
  A parameter has been set, published on `[:param | path]` with the frame_id `:parameter`.

  `source` says by whom:

    * `:local` - `BB.Parameter.set/3` or `set_many/2`
    * `:init` - its default, when the robot starts or the parameter is registered
    * `:persisted` - the store, then
    * `:startup` - `start_link(params: …)`

  `old_value` is `nil` for the last three. When a parameter's message arrives `BB.Parameter.get/2` has its value already,
  or a newer one.
  """

  @sources [:local, :init, :persisted, :startup]

  defstruct [:path, :old_value, :new_value, :source]

  @type source :: :local | :init | :persisted | :startup

  @type t :: %__MODULE__{
          path: BB.Parameter.path(),
          old_value: term(),
          new_value: term(),
          source: source()
        }

  use BB.Message,
    schema: [
      path: [type: {:list, :atom}, required: true, doc: "The parameter."],
      old_value: [type: :any, default: nil, doc: "Its value before."],
      new_value: [type: :any, required: true, doc: "Its value now."],
      source: [type: {:in, @sources}, required: true, doc: "Who set it."]
    ]
end
