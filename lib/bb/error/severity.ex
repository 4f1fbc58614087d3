defprotocol BB.Error.Severity do
  @moduledoc """
  How bad an error is.

  Each module that uses `BB.Error` implements it in its body:

      defimpl BB.Error.Severity do
        def severity(_error), do: :warning
      end

  `BB.Error.severity/1` asks for it.
  """

  @doc "Returns `:critical`, `:error` or `:warning`."
  @spec severity(t()) :: BB.Error.severity()
  def severity(error)
end
