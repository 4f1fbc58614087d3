defmodule BB.Error.State.CommandCrashed do
  @moduledoc """
  A command raised or its process crashed.

      iex> error = %BB.Error.State.CommandCrashed{
      ...>   command: :wave,
      ...>   exception: %RuntimeError{message: "oops"}
      ...> }
      iex> Exception.message(error)
      "command :wave crashed: oops"
  """

  use BB.Error, class: :state, fields: [:command, :exception]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "command #{inspect(e.command)} crashed: #{text(e.exception)}"
end
