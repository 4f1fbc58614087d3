defmodule BB.Options.ValidationError do
  @moduledoc """
  The error that `BB.Options.validate/2` returns for options that do not fit their schema.

  It is an exception: raise it, or turn it into text with `Exception.message/1`. For options
  inside options, the text ends with the keys that lead to them.

      iex> schema = [filter: [type: :keyword_list, keys: [size: [type: :integer]]]]
      iex> {:error, error} = BB.Options.validate([filter: [size: 1.0]], schema)
      iex> {error.key, error.value, error.keys_path}
      {:size, 1.0, [:filter]}
      iex> Exception.message(error)
      "invalid value for :size option: expected integer, got: 1.0 (in options [:filter])"

  The fields are:

    * `:message` - the text without the keys at its end
    * `:key` - the option, or the list of unknown options
    * `:value` - the value given for it, or `nil` if there was none
    * `:keys_path` - the keys that lead to a nested option, outermost first
  """

  @type t :: %__MODULE__{
          message: String.t(),
          key: atom() | [atom()],
          value: term(),
          keys_path: [atom()]
        }

  defexception [:message, :key, :value, keys_path: []]

  @impl Exception
  def message(%__MODULE__{message: message, keys_path: []}), do: message

  def message(%__MODULE__{message: message, keys_path: keys}),
    do: "#{message} (in options #{inspect(keys)})"
end
