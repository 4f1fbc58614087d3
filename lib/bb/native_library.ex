defmodule BB.NativeLibrary do
  @moduledoc false
  # Loads a NIF: by Rustler where it is a dependency (boards), otherwise by the same few lines
  # here (the host has no Hex). It is a macro because both branches of an `if` in a module's body
  # are expanded.

  defmacro __using__(library) do
    if Code.ensure_loaded?(Rustler), do: use_rustler(library), else: load_directly(library)
  end

  defp use_rustler(library) do
    quote do
      use Rustler,
        otp_app: :ganglion,
        crate: unquote(library),
        skip_compilation?: true,
        load_from: {:ganglion, "priv/#{unquote(library)}"}
    end
  end

  defp load_directly(library) do
    quote do
      @on_load :load_nif

      @doc false
      def load_nif, do: :erlang.load_nif(BB.NativeLibrary.path(unquote(library)), 0)
    end
  end

  @doc false
  def path(library),
    do: :ganglion |> Application.app_dir(["priv", library]) |> String.to_charlist()
end
