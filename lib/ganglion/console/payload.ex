defmodule Ganglion.Console.Payload do
  @moduledoc """
  Formats the payload of a message as one line of text for a person.

  `Ganglion.Console.watch/2` and the screen of `bin/demo` use it. It shows the fields by name and
  rounds the numbers. It is pure.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> imu = %BB.Message.Sensor.Imu{
      ...>   orientation: Quaternion.identity(),
      ...>   angular_velocity: Vec3.new(0.0, 0.0125, -1.5),
      ...>   linear_acceleration: Vec3.new(0.0, 0.0, 9.81)
      ...> }
      iex> line = Ganglion.Console.Payload.line(imu)
      iex> line =~ "angular_velocity 0.0 0.0125 -1.5, linear_acceleration 0.0 0.0 9.81"
      true

  It leaves out covariances and fields without a value. Of a long list it shows the first elements
  and the length, of bytes their number.
  """

  alias BB.Math.{Covariance3, Covariance6}

  @elements 6
  @text_bytes 60

  @doc "Returns the payload as one line of text."
  @spec line(term()) :: String.t()
  def line(%_module{} = payload), do: payload |> fields() |> Enum.join(", ")
  def line(payload), do: value(payload)

  defp fields(struct) do
    for {name, value} <- struct |> Map.from_struct() |> Enum.sort(), shown?(value) do
      "#{name} #{value(value)}"
    end
  end

  defp shown?(nil), do: false
  defp shown?(%Covariance3{}), do: false
  defp shown?(%Covariance6{}), do: false
  defp shown?(_value), do: true

  defp value(number) when is_float(number), do: float(number)
  defp value(number) when is_integer(number), do: Integer.to_string(number)
  defp value(atom) when is_atom(atom), do: Atom.to_string(atom)
  defp value(bytes) when is_binary(bytes), do: bytes(bytes)
  defp value([]), do: "none"
  defp value(list) when is_list(list), do: elements(list)
  defp value(tuple) when is_tuple(tuple), do: tuple |> Tuple.to_list() |> elements()
  defp value(%_module{} = struct), do: nested(struct)
  defp value(term), do: inspect(term, limit: @elements)

  # The numbers of a point, a vector or a rotation, in the order of their names.
  defp nested(struct) do
    values = struct |> Map.from_struct() |> Enum.sort() |> Keyword.values()

    if Enum.all?(values, &is_number/1),
      do: elements(values),
      else: "{" <> Enum.join(fields(struct), ", ") <> "}"
  end

  # The rescue is for an improper list.
  defp elements(list) do
    case Enum.split(list, @elements) do
      {shown, []} -> Enum.map_join(shown, " ", &value/1)
      {shown, _more} -> Enum.map_join(shown, " ", &value/1) <> " ... (#{length(list)})"
    end
  rescue
    _improper -> inspect(list, limit: @elements)
  end

  defp float(number) when number == 0.0, do: "0.0"

  defp float(number) when abs(number) >= 0.001 and abs(number) < 1.0e7,
    do: :erlang.float_to_binary(number, [:compact, decimals: 4])

  defp float(number), do: :erlang.float_to_binary(number, scientific: 3)

  defp bytes(bytes) do
    if byte_size(bytes) <= @text_bytes and String.printable?(bytes),
      do: inspect(bytes),
      else: "<#{byte_size(bytes)} bytes>"
  end
end
