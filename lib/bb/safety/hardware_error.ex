defmodule BB.Safety.HardwareError do
  @moduledoc """
  The payload for a fault that a component finds in its hardware. `BB.Safety.report_error/3`
  publishes it on `[:safety, :error]`.

      {:ok, _} = BB.subscribe(MyRobot, [:safety, :error])

      receive do
        {:bb, _path, %{payload: %BB.Safety.HardwareError{path: path}}} -> path
      end
  """

  defstruct [:path, :error]

  @type t :: %__MODULE__{path: [atom()], error: term()}

  use BB.Message,
    schema: [
      path: [type: {:list, :atom}, required: true, doc: "The component's path."],
      error: [type: :any, required: true, doc: "The fault, in the component's own terms."]
    ]
end
