defmodule BB.Ring.Native do
  @moduledoc false

  # Elixir loads a module that it has just compiled. A NIF for a board must not be loaded on the
  # machine that builds it.
  @compile {:autoload, false}

  use BB.NativeLibrary, "conduit_ring_nif"

  def now_ns, do: not_loaded()
  def nothing, do: not_loaded()
  def topic_info(_topic), do: not_loaded()
  def content_tag(_name), do: not_loaded()
  def trust(_users, _groups), do: not_loaded()

  def publisher_open(_topic, _options), do: not_loaded()
  def publish_binary(_publisher, _data), do: not_loaded()
  def publish_iovec(_publisher, _data), do: not_loaded()
  def publish_large(_publisher, _data), do: not_loaded()
  def publisher_info(_publisher), do: not_loaded()
  def publisher_trouble(_publisher), do: not_loaded()
  def publisher_close(_publisher), do: not_loaded()

  def subscriber_open(_topic, _ref, _options), do: not_loaded()
  def subscriber_active(_subscriber, _active), do: not_loaded()
  def subscriber_request(_subscriber, _kind), do: not_loaded()
  def subscriber_cancel(_subscriber, _id), do: not_loaded()
  def subscriber_close(_subscriber), do: not_loaded()

  def lease_message(_lease), do: not_loaded()
  def lease_release(_lease), do: not_loaded()
  def lease_detach(_lease), do: not_loaded()

  defp not_loaded, do: :erlang.nif_error(:not_loaded)
end
