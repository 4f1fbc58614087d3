defmodule BB.Dsl.ParamRef do
  @moduledoc """
  Another name for `BB.Parameter.Reference`. Use it in code that was written for Beam Bots, where
  the module has this name:

      iex> import BB.Dsl.ParamRef
      iex> param([:imu, :rate])
      %BB.Parameter.Reference{path: [:imu, :rate]}
  """

  @doc "Returns a reference to a parameter. See `BB.Parameter.Reference.param/1`."
  @spec param(BB.Parameter.Reference.path()) :: BB.Parameter.Reference.t()
  defdelegate param(path), to: BB.Parameter.Reference
end
