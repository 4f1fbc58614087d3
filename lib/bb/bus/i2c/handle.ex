defmodule BB.Bus.I2C.Handle do
  @moduledoc "One opening of a shared bus, see `BB.Bus.I2C.open/2`."

  @enforce_keys [:name, :backend, :timeout_ms, :pid, :ref, :retries]
  defstruct [:name, :backend, :timeout_ms, :pid, :ref, :retries]

  @type t :: %__MODULE__{
          name: String.t(),
          backend: module(),
          timeout_ms: pos_integer(),
          pid: pid(),
          ref: reference(),
          retries: non_neg_integer()
        }
end
