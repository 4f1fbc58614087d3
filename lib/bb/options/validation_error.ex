defmodule BB.Options.ValidationError do
  @moduledoc """
  Options that do not fit their schema, returned by `BB.Options.validate/2`.

  It is an exception, so it can be raised as it is, or turned into a sentence by `Exception.message/1`. For options inside
  options the sentence ends with the keys that lead to the place: ` (in options [:filter])`.

    * `:message` - what is wrong, without that ending
    * `:key` - the option, or the list of options that are unknown
    * `:value` - what was given for it; `nil` when nothing was
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
