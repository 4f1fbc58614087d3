defmodule BB.Test.Keys do
  @moduledoc """
  Keys for OTP's ssh, in memory: `key_cb: {BB.Test.Keys, host: key, user: key, authorized:
  [public]}`.
  """

  @behaviour :ssh_server_key_api
  @behaviour :ssh_client_key_api

  @doc "Returns a pair of keys: `{private, public}`, the public one as bytes."
  def pair do
    private = :public_key.generate_key({:namedCurve, :ed25519})
    {private, elem(private, 4)}
  end

  @impl :ssh_server_key_api
  def host_key(:"ssh-ed25519", opts), do: {:ok, opts[:key_cb_private][:host]}
  def host_key(_algorithm, _opts), do: {:error, :none}

  @impl :ssh_server_key_api
  def is_auth_key({{:ECPoint, bytes}, _curve}, _user, opts),
    do: bytes in opts[:key_cb_private][:authorized]

  @impl :ssh_client_key_api
  def user_key(:"ssh-ed25519", opts) do
    with nil <- opts[:key_cb_private][:user], do: {:error, :none}, else: (key -> {:ok, key})
  end

  def user_key(_algorithm, _opts), do: {:error, :none}

  @impl :ssh_client_key_api
  def is_host_key(_key, _host, _algorithm, _opts), do: true

  @impl :ssh_client_key_api
  def add_host_key(_host, _key, _opts), do: :ok
end
