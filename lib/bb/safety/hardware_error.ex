defmodule BB.Safety.HardwareError do
  @moduledoc "A component found its hardware at fault (`BB.Safety.report_error/3`). Published on `[:safety, :error]`."

  defstruct [:path, :error]

  @type t :: %__MODULE__{path: [atom()], error: term()}

  use BB.Message,
    schema: [
      path: [type: {:list, :atom}, required: true, doc: "The component's path."],
      error: [type: :any, required: true, doc: "What is wrong, as the component says it."]
    ]
end
