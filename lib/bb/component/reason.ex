defmodule BB.Component.Reason do
  @moduledoc """
  The reason for which a component is down: without its stack trace, and as text.

  `BB.Component.Keeper` uses it for each error, and `BB.Sensor.explain/2` for a reason that a user
  has received.

      iex> BB.Component.Reason.format({:init_timeout, 5_000}, BB.Sensor.Mpu6050)
      "init/1 has not returned for 5000 ms"
  """

  alias BB.Callback

  @longest_bytes 2_000

  @doc """
  Removes the stack trace and the `:shutdown` of an exit reason.

      iex> BB.Component.Reason.normalize({:badarith, [{:erlang, :/, [1, 0], []}]})
      :badarith
      iex> BB.Component.Reason.normalize({:i2c_nak, "i2c-1", 0x68})
      {:i2c_nak, "i2c-1", 104}
  """
  @spec normalize(term()) :: term()
  def normalize({reason, [{module, function, _, _} | _]})
      when is_atom(module) and is_atom(function),
      do: reason

  def normalize({:shutdown, reason}), do: normalize(reason)
  def normalize(reason), do: reason

  @doc """
  Returns an exit reason that can be shown (`BB.Callback.showable/1`).

  That is the reason itself, or another in its place where its code fails to show it. Any process
  may have sent the reason, so the check runs apart from the caller.
  """
  @spec showable(term()) :: term()
  def showable(reason) when is_atom(reason), do: reason

  def showable(reason) do
    case Callback.call({Callback, :showable, [reason]}, quiet: true, remember: false) do
      {:ok, reason} -> reason
      {:error, _failure} -> :a_reason_that_cannot_be_shown
    end
  end

  @doc """
  Formats a reason, by the component's module (`explain/1`) where that has a clause for it.

      iex> BB.Component.Reason.format(%RuntimeError{message: "no answer"}, BB.Sensor.Mpu6050)
      "no answer"
      iex> BB.Component.Reason.format({:i2c_nak, "i2c-1", 0x68}, BB.Sensor.Mpu6050)
      ~s({:i2c_nak, "i2c-1", 104})
  """
  @spec format(term(), module()) :: String.t()
  def format({:init_timeout, timeout_ms}, _module),
    do: "init/1 has not returned for #{timeout_ms} ms"

  def format({:silent, silence_ms}, _module),
    do: "published nothing for #{silence_ms} ms"

  def format({:unchecked_options, text}, _module),
    do: "options could not be checked: #{text}"

  def format(reason, module) do
    case format_by_module(reason, module) do
      {:ok, text} -> text
      :error -> inspect_reason(reason)
    end
  end

  defp format_by_module(reason, _module) when is_binary(reason), do: text(reason)
  defp format_by_module(reason, _module) when is_exception(reason), do: exception_message(reason)

  defp format_by_module(reason, module) do
    if Code.ensure_loaded?(module) and function_exported?(module, :explain, 1),
      do: explain(reason, module),
      else: :error
  end

  defp exception_message(%{__struct__: module} = exception) do
    call({Exception, :message, [exception]},
      name: {module, :message, 1},
      expected: "a string",
      instead: "the exception is shown as a term"
    )
  end

  defp explain(reason, module) do
    call({module, :explain, [reason]},
      expected: "a string",
      instead: "the reason is shown as a term",
      partial: true
    )
  end

  # A struct's module may define how it is inspected.
  defp inspect_reason(reason) do
    name = "showing the reason of a component"

    case call({Kernel, :inspect, [reason]}, name: name, remember: false) do
      {:ok, text} -> text
      :error -> "a reason that cannot be shown"
    end
  end

  defp call(mfa, opts) do
    with {:error, _failure} <- Callback.call(mfa, [accept: &text/1] ++ opts), do: :error
  end

  @doc false
  @spec text(term()) :: {:ok, String.t()} | :error
  def text(text) when is_binary(text) and text != "" do
    text |> binary_part(0, min(byte_size(text), @longest_bytes)) |> whole_characters()
  end

  def text(_other), do: :error

  # The last character may have been cut.
  defp whole_characters(bytes) do
    case :unicode.characters_to_binary(bytes) do
      {:incomplete, text, _cut} -> {:ok, :binary.copy(text)}
      {:error, _text, _bytes} -> :error
      text -> {:ok, :binary.copy(text)}
    end
  end
end
