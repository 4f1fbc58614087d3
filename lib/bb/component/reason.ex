defmodule BB.Component.Reason do
  @moduledoc """
  Why a component is down: the reason of its exit, without what only a debugger wants, and in words.
  """

  alias BB.Callback

  @longest_bytes 2_000

  @doc """
  The reason of an exit without its stack trace.

      iex> BB.Component.Reason.plain({:badarith, [{:erlang, :/, [1, 0], []}]})
      :badarith
      iex> BB.Component.Reason.plain({:i2c_nak, "i2c-1", 0x68})
      {:i2c_nak, "i2c-1", 104}
  """
  @spec plain(term()) :: term()
  def plain({reason, [{module, function, _, _} | _]}) when is_atom(module) and is_atom(function),
    do: reason

  def plain({:shutdown, reason}), do: plain(reason)
  def plain(reason), do: reason

  @doc """
  The reason of an exit that comes from elsewhere, as a keeper may tell it: itself, or another in its
  place where it cannot be shown (`BB.Callback.showable/1`).
  """
  @spec received(term()) :: term()
  def received(reason) when is_atom(reason), do: reason

  def received(reason) do
    case Callback.call({Callback, :showable, [reason]}, quiet: true, remember: false) do
      {:ok, reason} -> reason
      {:error, _failure} -> :a_reason_that_cannot_be_shown
    end
  end

  @doc """
  The reason in words: those of the component's own module (`explain/1`), where it has some for it.

      iex> BB.Component.Reason.words(%RuntimeError{message: "no answer"}, BB.Sensor.Mpu6050)
      "no answer"
      iex> BB.Component.Reason.words({:i2c_nak, "i2c-1", 0x68}, BB.Sensor.Mpu6050)
      ~s({:i2c_nak, "i2c-1", 104})
  """
  @spec words(term(), module()) :: String.t()
  def words({:init_timeout, timeout_ms}, _module),
    do: "its init has not returned for #{timeout_ms} ms"

  def words({:silent, silence_ms}, _module),
    do: "it has published nothing for #{silence_ms} ms"

  def words({:unchecked_options, what}, _module),
    do: "its options could not be checked: #{what}"

  def words(reason, module) do
    case said(reason, module) do
      {:ok, text} -> text
      :error -> shown(reason)
    end
  end

  # Its own words. What it has no words for, it may be wrong about too.
  defp said(reason, _module) when is_binary(reason), do: text(reason)
  defp said(reason, _module) when is_exception(reason), do: message(reason)

  defp said(reason, module) do
    if Code.ensure_loaded?(module) and function_exported?(module, :explain, 1),
      do: explained(reason, module),
      else: :error
  end

  defp message(%{__struct__: module} = exception) do
    ask({Exception, :message, [exception]},
      name: {module, :message, 1},
      expected: "a text",
      instead: "the exception is shown as a term"
    )
  end

  defp explained(reason, module) do
    ask({module, :explain, [reason]},
      expected: "a text",
      instead: "the reason is shown as a term",
      partial: true
    )
  end

  # How a struct is shown is up to the struct.
  defp shown(reason) do
    name = "showing the reason of a component"

    case ask({Kernel, :inspect, [reason]}, name: name, remember: false) do
      {:ok, text} -> text
      :error -> "a reason that cannot be shown"
    end
  end

  defp ask(mfa, opts) do
    with {:error, _failure} <- Callback.call(mfa, [accept: &text/1] ++ opts), do: :error
  end

  @doc false
  @spec text(term()) :: {:ok, String.t()} | :error
  def text(text) when is_binary(text) and text != "" do
    text |> binary_part(0, min(byte_size(text), @longest_bytes)) |> whole()
  end

  def text(_other), do: :error

  # A character that was cut is left out.
  defp whole(bytes) do
    case :unicode.characters_to_binary(bytes) do
      {:incomplete, text, _cut} -> {:ok, :binary.copy(text)}
      {:error, _text, _bytes} -> :error
      text -> {:ok, :binary.copy(text)}
    end
  end
end
