defmodule BB.Bus.I2C.Handle do
  @moduledoc "One opening of a shared bus, see `BB.Bus.I2C.open/2`."

  @enforce_keys [:name, :pid, :ref, :retries]
  defstruct [:name, :pid, :ref, :retries]

  @type t :: %__MODULE__{
          name: String.t(),
          pid: pid(),
          ref: reference(),
          retries: non_neg_integer()
        }
end
