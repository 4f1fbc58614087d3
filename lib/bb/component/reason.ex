defmodule BB.Component.Reason do
  @moduledoc """
  Why a component is down: the reason of its exit, without what only a debugger wants, and in words.
  """

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
  The reason in words.

      iex> BB.Component.Reason.words(%RuntimeError{message: "no answer"})
      "no answer"
      iex> BB.Component.Reason.words({:i2c_nak, "i2c-1", 0x68})
      ~s({:i2c_nak, "i2c-1", 104})
  """
  @spec words(term()) :: String.t()
  def words(reason) when is_exception(reason), do: Exception.message(reason)
  def words(reason) when is_binary(reason), do: reason

  def words({:init_timeout, timeout_ms}),
    do: "its init has not returned for #{timeout_ms} ms"

  def words({:silent, silence_ms}), do: "it has published nothing for #{silence_ms} ms"
  def words(reason), do: inspect(reason)
end
