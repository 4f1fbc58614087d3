defmodule BB.Ring.Trust do
  @moduledoc false
  # Passes the configured trusted users and groups to the ring when the configuration has changed.

  alias BB.Ring.Native

  @keys [:trusted_users, :trusted_groups]

  @doc false
  @spec apply!() :: :ok
  def apply! do
    configured = Application.get_env(:ganglion, BB.Ring, [])

    if :persistent_term.get(__MODULE__, []) != configured do
      :ok = trust!(configured)
      :persistent_term.put(__MODULE__, configured)
    end

    :ok
  end

  defp trust!(configured) do
    [users, groups] = Enum.map(@keys, &list!(configured, &1))

    case Native.trust(users, groups) do
      :ok -> :ok
      {:error, message} -> raise ArgumentError, "config :ganglion, BB.Ring: #{message}"
    end
  end

  defp list!(configured, key) do
    valid? = Keyword.keyword?(configured) and Enum.all?(Keyword.keys(configured), &(&1 in @keys))
    entries = if valid?, do: Keyword.get(configured, key, [])

    if is_list(entries) and Enum.all?(entries, &entry?/1) do
      Enum.join(entries, ",")
    else
      raise ArgumentError,
            "config :ganglion, BB.Ring: expected trusted_users: and trusted_groups: as lists " <>
              "of numbers and names, got: #{inspect(configured)}"
    end
  end

  defp entry?(entry), do: (is_integer(entry) and entry >= 0) or (is_binary(entry) and entry != "")
end
