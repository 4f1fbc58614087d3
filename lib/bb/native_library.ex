defmodule BB.NativeLibrary do
  @moduledoc false
  # Rustler's loader where Rustler is a dependency (boards), the same in a few lines where it is not (the host has no Hex).
  # A macro, since both branches of an `if` in a module's body would be expanded.

  defmacro __using__(library) do
    if Code.ensure_loaded?(Rustler), do: by_rustler(library), else: by_hand(library)
  end

  defp by_rustler(library) do
    quote do
      use Rustler,
        otp_app: :ganglion,
        crate: unquote(library),
        skip_compilation?: true,
        load_from: {:ganglion, "priv/#{unquote(library)}"}
    end
  end

  defp by_hand(library) do
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
